"""What is served, checked by the tools and rules of those who read it."""

"""The pages for people: one module per page; what they say stands in the templates."""

"""What is done to a day, a burst or a submission, as plain functions: search, time, solve, choose, publish, draw."""

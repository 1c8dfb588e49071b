"""Driven routes as a page: scores of drivers, and what went wrong on the worst routes."""

"""Fixtures that tests of pages share."""

from browser_fixture import browser  # noqa: F401

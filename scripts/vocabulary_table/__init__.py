"""Vocabularies, records and tables of scripts/vocabularies.py."""

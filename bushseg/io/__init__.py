"""Scans in and out, by suffix."""

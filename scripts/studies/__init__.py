"""Measurements that are made now and then, not on every change: `python -m studies.NAME`."""

"""Measurements that take minutes, each made by one command."""

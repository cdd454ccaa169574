"""The report of a DH fit."""

"""Fault injection: the text form, effect and schedule of faults."""

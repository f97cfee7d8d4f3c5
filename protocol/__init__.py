"""The wire protocol: one declaration of every message, and everything generated from it.

Pure and sans-I/O: standard library, numpy and ``cobs`` only.
"""

"""Shared code of the bring-up and calibration commands."""

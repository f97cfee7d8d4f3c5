"""Bring-up and calibration: a person checks one device step by step.

``procedure`` is the bring-up, ``session`` its session with the device, and ``wiring`` evaluates the
measurements. ``gyro``, ``umbmark`` and ``ranging`` compute calibrations. ``values`` and
``applying`` write the results to the robot file and to the device.
"""

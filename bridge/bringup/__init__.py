"""A person at the bench: one device in hand, asked and moved step by step.

``desk`` talks to it, ``wiring`` judges what bring-up saw, ``gyro``, ``umbmark`` and ``ranging``
work out calibrations, ``values`` brings their results to the robot file and to the device.
"""

"""Pictures of the robot's behaviour for docs/, each drawn from a simulated run.

    .venv/bin/python -m tools.dev.behaviour_pictures --out docs/images

Every run is in virtual time, in a room of sweepctl, with a fixed seed. So equal code draws equal
pictures. ``--only NAME`` draws only one picture. The program needs the extra ``plot``.
"""

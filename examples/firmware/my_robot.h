/* The robot: what differs from core/robot.h, and a parameter of its own. */
#ifndef MY_ROBOT_H
#define MY_ROBOT_H

#define ROBOT_BATTERY_V 14.8f

/* NAME, "name unit", factory value, lowest, highest, kind, flags. */
#define OWN_PARAMETERS(X) X(BIN_VOLUME, "bin_volume l", 0.5f, 0.1f, 5.0f, F32, 0)

#endif

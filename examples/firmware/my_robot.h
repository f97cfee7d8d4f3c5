/* The robot: what differs from core/robot.h, and a parameter of its own. */
#ifndef MY_ROBOT_H
#define MY_ROBOT_H

#define ROBOT_MAX_ACCEL_M_S2 0.40f
#define ROBOT_MAX_YAW_ACCEL_RAD_S2 8.0f
#define ROBOT_BATTERY_V 16.0f
#define ROBOT_NOMINAL_V 16.0f
#define ROBOT_LEAST_V 8.0f
#define ROBOT_FEED_FORWARD 2.12f
#define ROBOT_FRICTION 0.15f
#define ROBOT_PROPORTIONAL 1.6f
#define ROBOT_INTEGRAL_PER_S 12.0f
#define ROBOT_INTEGRAL_LIMIT 0.5f

/* NAME, "name unit", factory value, lowest, highest, kind, flags. */
#define OWN_PARAMETERS(X) X(BIN_VOLUME, "bin_volume l", 0.5f, 0.1f, 5.0f, F32, 0)

#endif

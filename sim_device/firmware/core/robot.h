/* The robot that this firmware is built for: limits, gains, and the factory values of its parameters.
 * Change them here, or pass -DROBOT_CONFIG='"my_robot.h"'. This file must define the names below,
 * and the names of parameter_table.h with different values. */
#ifndef ROBOT_H
#define ROBOT_H

#ifdef ROBOT_CONFIG
#include ROBOT_CONFIG
#else

#define ROBOT_MAX_ACCEL_M_S2 0.40f
#define ROBOT_MAX_YAW_ACCEL_RAD_S2 8.0f
#define ROBOT_BATTERY_V 16.0f /* used until the supply is measured */

/* Wheel control gains, duty per m/s. The feed-forward is for the drive motors at the nominal supply
 * voltage. */
#define ROBOT_NOMINAL_V 16.0f
#define ROBOT_LEAST_V 8.0f
#define ROBOT_FEED_FORWARD 2.12f
#define ROBOT_FRICTION 0.15f /* duty that overcomes the bridge's drop and the friction */
#define ROBOT_PROPORTIONAL 1.6f
#define ROBOT_INTEGRAL_PER_S 12.0f
#define ROBOT_INTEGRAL_LIMIT 0.5f

#endif

#include "parameter_table.h"

/* Your own parameters, which follow the parameters of the table; in the format of
 * PARAMETER_TABLE. */
#ifndef OWN_PARAMETERS
#define OWN_PARAMETERS(X)
#endif

#endif

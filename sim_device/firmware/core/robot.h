/* The robot that this firmware is built for: limits, gains, and the factory values of its parameters.
 * Change them here, or pass -DROBOT_CONFIG='"my_robot.h"'. That file defines the names of this file
 * and of parameter_table.h whose values differ. */
#ifndef ROBOT_H
#define ROBOT_H

#ifdef ROBOT_CONFIG
#include ROBOT_CONFIG
#endif

#ifndef ROBOT_MAX_ACCEL_M_S2
#define ROBOT_MAX_ACCEL_M_S2 0.40f /* of the device's planner; a host limits its own commands */
#endif
#ifndef ROBOT_MAX_YAW_ACCEL_RAD_S2
#define ROBOT_MAX_YAW_ACCEL_RAD_S2 8.0f /* of the device's planner */
#endif
#ifndef ROBOT_BATTERY_V
#define ROBOT_BATTERY_V 16.0f /* used until the supply is measured */
#endif
#ifndef ROBOT_NOMINAL_V
#define ROBOT_NOMINAL_V 16.0f /* supply voltage to which the gains refer */
#endif
#ifndef ROBOT_LEAST_V
#define ROBOT_LEAST_V 8.0f /* a lower supply voltage counts as this */
#endif
#ifndef ROBOT_FEED_FORWARD
#define ROBOT_FEED_FORWARD 2.12f /* duty per m/s: (1 - friction) / top speed of a wheel */
#endif
#ifndef ROBOT_FRICTION
#define ROBOT_FRICTION 0.15f /* duty that overcomes the bridge's drop and the friction */
#endif
#ifndef ROBOT_PROPORTIONAL
#define ROBOT_PROPORTIONAL 1.6f /* duty per m/s of error */
#endif
#ifndef ROBOT_INTEGRAL_PER_S
#define ROBOT_INTEGRAL_PER_S 12.0f /* duty per m of error */
#endif
#ifndef ROBOT_INTEGRAL_LIMIT
#define ROBOT_INTEGRAL_LIMIT 0.5f /* largest duty of the integral */
#endif

#include "parameter_table.h"

/* Your own parameters, which follow the parameters of the table; in the format of
 * PARAMETER_TABLE. */
#ifndef OWN_PARAMETERS
#define OWN_PARAMETERS(X)
#endif

#endif

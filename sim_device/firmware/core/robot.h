/* The robot that this firmware is built for: factory values of its parameters, and places of its
 * sensors. Change them here, or pass -DROBOT_CONFIG='"my_robot.h"' with a file that defines the
 * same names. */
#ifndef ROBOT_H
#define ROBOT_H

#ifdef ROBOT_CONFIG
#include ROBOT_CONFIG
#else

#define ROBOT_DIAMETER_M 0.32f
#define ROBOT_CLEANING_WIDTH_M 0.16f
#define ROBOT_MOUTH_OFFSET_M 0.0f /* of the mouth ahead of the axle */
#define ROBOT_WHEEL_DIAMETER_M 0.065f
#define ROBOT_WHEEL_BASE_M 0.23f
#define ROBOT_COUNTS_PER_TURN 1560u /* after x4 */
#define ROBOT_CRUISE_SPEED_M_S 0.20f
#define ROBOT_MAX_SPEED_M_S 0.30f
#define ROBOT_MAX_YAW_RATE_RAD_S 2.0f
#define ROBOT_MAX_ACCEL_M_S2 0.40f
#define ROBOT_MAX_YAW_ACCEL_RAD_S2 8.0f
#define ROBOT_BATTERY_V 16.0f /* until it is measured */

/* Deceleration of a stop: from top speed to rest in 0.3 s, the most that the tyres hold without
 * slipping. */
#define ROBOT_STOP_DECELERATION_M_S2 1.0f
#define ROBOT_BATTERY_LOW_V 12.8f   /* 3.2 V a cell of four */
#define ROBOT_BATTERY_EMPTY_V 12.0f /* 3.0 V: a second below it damages a pack */

/* Wheel control gains, duty per m/s; the feed-forward matches the drive motors at the nominal
 * supply. */
#define ROBOT_NOMINAL_V 16.0f
#define ROBOT_LEAST_V 8.0f
#define ROBOT_FEED_FORWARD 2.12f
#define ROBOT_FRICTION 0.15f /* duty that overcomes the bridge's drop and the friction */
#define ROBOT_PROPORTIONAL 1.6f
#define ROBOT_INTEGRAL_PER_S 12.0f
#define ROBOT_INTEGRAL_LIMIT 0.5f

#endif
#endif

/* Made by `python -m tools.dev.firmware_tables` from sim_device/device/parameters.py: change that. */
#ifndef PARAMETER_TABLE_H
#define PARAMETER_TABLE_H

/* Factory values. Your ROBOT_CONFIG (robot.h) may define others before. */
#ifndef ROBOT_WHEEL_DIAMETER_M
#define ROBOT_WHEEL_DIAMETER_M 0.065f /* mean of both wheels */
#endif
#ifndef ROBOT_WHEEL_BASE_M
#define ROBOT_WHEEL_BASE_M 0.23f /* distance between the wheels */
#endif
#ifndef ROBOT_COUNTS_PER_TURN
#define ROBOT_COUNTS_PER_TURN 1560.0f /* encoder counts after x4 */
#endif
#ifndef ROBOT_MAX_SPEED_M_S
#define ROBOT_MAX_SPEED_M_S 0.3f /* limit of the forward speed */
#endif
#ifndef ROBOT_MAX_YAW_RATE_RAD_S
#define ROBOT_MAX_YAW_RATE_RAD_S 2.0f /* limit of the yaw rate */
#endif
#ifndef ROBOT_CRUISE_SPEED_M_S
#define ROBOT_CRUISE_SPEED_M_S 0.2f /* of the device's planner */
#endif
#ifndef ROBOT_STOP_DECELERATION_M_S2
#define ROBOT_STOP_DECELERATION_M_S2 1.0f /* deceleration of a stop */
#endif
#ifndef ROBOT_BATTERY_LOW_V
#define ROBOT_BATTERY_LOW_V 12.8f /* below it the fault battery_low is set */
#endif
#ifndef ROBOT_DIAMETER_M
#define ROBOT_DIAMETER_M 0.32f /* of the footprint */
#endif
#ifndef ROBOT_CLEANING_WIDTH_M
#define ROBOT_CLEANING_WIDTH_M 0.16f /* width of the mouth */
#endif
#ifndef ROBOT_MOUTH_OFFSET_M
#define ROBOT_MOUTH_OFFSET_M 0.0f /* mouth ahead of the axle */
#endif
#ifndef ROBOT_BATTERY_EMPTY_V
#define ROBOT_BATTERY_EMPTY_V 12.0f /* below it for 1 s driving ends */
#endif
#ifndef ROBOT_WHEEL_RATIO
#define ROBOT_WHEEL_RATIO 1.0f /* right over left diameter */
#endif
#ifndef ROBOT_GYRO_BIAS_RAD_S
#define ROBOT_GYRO_BIAS_RAD_S 0.0f /* yaw rate read at rest */
#endif
#ifndef ROBOT_ULTRASONIC_SCALE
#define ROBOT_ULTRASONIC_SCALE 1.0f /* true over raw range */
#endif
#ifndef ROBOT_ULTRASONIC_OFFSET_M
#define ROBOT_ULTRASONIC_OFFSET_M 0.0f /* added to its range */
#endif
#ifndef ROBOT_INFRARED_LEFT_SCALE
#define ROBOT_INFRARED_LEFT_SCALE 1.0f /* true over raw range */
#endif
#ifndef ROBOT_INFRARED_LEFT_OFFSET_M
#define ROBOT_INFRARED_LEFT_OFFSET_M 0.0f /* added to its range */
#endif
#ifndef ROBOT_INFRARED_RIGHT_SCALE
#define ROBOT_INFRARED_RIGHT_SCALE 1.0f /* true over raw range */
#endif
#ifndef ROBOT_INFRARED_RIGHT_OFFSET_M
#define ROBOT_INFRARED_RIGHT_OFFSET_M 0.0f /* added to its range */
#endif
#ifndef ROBOT_CLIFF_REFLEX
#define ROBOT_CLIFF_REFLEX 1.0f /* 1: no forward speed at a cliff */
#endif
#ifndef ROBOT_BUMPER_REFLEX
#define ROBOT_BUMPER_REFLEX 1.0f /* 1: slow forward speed with a bumper pressed */
#endif

/* Every parameter by its number: X(NAME, label, factory, low, high, kind, flags). */
#define PARAMETER_TABLE(X) \
    X(NODE, "node id", 1.0f, 1.0f, 15.0f, U32, READ_ONLY) \
    X(WHEEL_DIAMETER, "wheel_diameter m", ROBOT_WHEEL_DIAMETER_M, 0.01f, 1.0f, F32, REBOOT) \
    X(WHEEL_BASE, "wheel_base m", ROBOT_WHEEL_BASE_M, 0.02f, 2.0f, F32, REBOOT) \
    X(COUNTS_PER_TURN, "counts_per_turn count", ROBOT_COUNTS_PER_TURN, 4.0f, 1000000.0f, U32, REBOOT) \
    X(MAX_SPEED, "max_speed m/s", ROBOT_MAX_SPEED_M_S, 0.01f, 2.0f, F32, 0) \
    X(MAX_YAW_RATE, "max_yaw_rate rad/s", ROBOT_MAX_YAW_RATE_RAD_S, 0.05f, 20.0f, F32, 0) \
    X(CRUISE_SPEED, "cruise_speed m/s", ROBOT_CRUISE_SPEED_M_S, 0.01f, 2.0f, F32, 0) \
    X(STOP_DECELERATION, "stop_deceleration m/s2", ROBOT_STOP_DECELERATION_M_S2, 0.2f, 5.0f, F32, 0) \
    X(BATTERY_LOW, "battery_low V", ROBOT_BATTERY_LOW_V, 3.0f, 60.0f, F32, 0) \
    X(ROBOT_DIAMETER, "robot_diameter m", ROBOT_DIAMETER_M, 0.05f, 2.0f, F32, REBOOT) \
    X(CLEANING_WIDTH, "cleaning_width m", ROBOT_CLEANING_WIDTH_M, 0.02f, 2.0f, F32, REBOOT) \
    X(MOUTH_OFFSET, "mouth_offset m", ROBOT_MOUTH_OFFSET_M, -1.0f, 1.0f, F32, REBOOT) \
    X(BATTERY_EMPTY, "battery_empty V", ROBOT_BATTERY_EMPTY_V, 3.0f, 60.0f, F32, 0) \
    X(WHEEL_RATIO, "wheel_ratio ratio", ROBOT_WHEEL_RATIO, 0.8f, 1.25f, F32, REBOOT) \
    X(GYRO_BIAS, "gyro_bias rad/s", ROBOT_GYRO_BIAS_RAD_S, -0.4f, 0.4f, F32, REBOOT) \
    X(ULTRASONIC_SCALE, "ultrasonic_scale ratio", ROBOT_ULTRASONIC_SCALE, 0.5f, 2.0f, F32, REBOOT) \
    X(ULTRASONIC_OFFSET, "ultrasonic_offset m", ROBOT_ULTRASONIC_OFFSET_M, -0.2f, 0.2f, F32, REBOOT) \
    X(INFRARED_LEFT_SCALE, "infrared_left_scale ratio", ROBOT_INFRARED_LEFT_SCALE, 0.5f, 2.0f, F32, REBOOT) \
    X(INFRARED_LEFT_OFFSET, "infrared_left_offset m", ROBOT_INFRARED_LEFT_OFFSET_M, -0.2f, 0.2f, F32, REBOOT) \
    X(INFRARED_RIGHT_SCALE, "infrared_right_scale ratio", ROBOT_INFRARED_RIGHT_SCALE, 0.5f, 2.0f, F32, REBOOT) \
    X(INFRARED_RIGHT_OFFSET, "infrared_right_offset m", ROBOT_INFRARED_RIGHT_OFFSET_M, -0.2f, 0.2f, F32, REBOOT) \
    X(CLIFF_REFLEX, "cliff_reflex bool", ROBOT_CLIFF_REFLEX, 0.0f, 1.0f, U32, 0) \
    X(BUMPER_REFLEX, "bumper_reflex bool", ROBOT_BUMPER_REFLEX, 0.0f, 1.0f, U32, 0)

#endif

#include "health.h"

#include <stddef.h>

#include "numbers.h"
#include "period.h"

#define STALL_TICKS 100u
/* Maximum time at stall current, control periods: 3 s. The planner ends an attempt after half of
 * this time. */
#define STALL_STOP_TICKS 300u
/* Minimum current of a stalled motor, mA. A stalled motor draws 1 A or more. A running motor with a
 * broken encoder draws a fifth of this limit. */
#define STALL_MA 400u
/* Minimum acceleration of a jolt, counts: 0.15 g. A lift by a person exceeds this limit (0.25 g for
 * 0.2 s). The mean reduces a vibration of 40 mg to 14 mg, and a sensor bias cancels out. */
#define JOLT_LSB ((int)(0.15f * BOARD_IMU_PER_G + 0.5f))
#define JOLT_SUM ((int32_t)GRAVITY_TICKS * JOLT_LSB)
#define JOLT_MEANS ((int32_t)(GRAVITY_TICKS / JOLT_MEAN_TICKS))
#define JOLT_TICKS 100u
#define REST_TICKS 50u
/* Maximum rate reading at rest, counts: 20 deg/s, the zero-rate output limit of the data sheet
 * (PS-MPU-6000A-00, section 6.1). */
#define REST_RATE_LSB ((int)(20.0f * BOARD_IMU_PER_DEG_S))
#define GRAVITY_LSB ((int)BOARD_IMU_PER_G)
#define GRAVITY_LOW_LSB (0.7f * BOARD_IMU_PER_G)
#define GRAVITY_HIGH_LSB (1.3f * BOARD_IMU_PER_G)
#define IMPLAUSIBLE_TICKS 30u
#define REPEAT_TICKS 50u
#define QUIET_TICKS 20u
#define LEARN_TICKS 200u
/* Maximum number of repeated readings of a chip with noise after its start. Nearly every chip has
 * noise. If such a chip repeats its readings for half a second, no new samples arrive. Repeats of a
 * chip without noise are a fault only if the yaw rate differs from the wheels' yaw rate. */
#define LIVELY_TICKS 3u
#define DISAGREE_RAD_S 0.2f
#define GYRO_RAD_S (PI_F / 180.0f / BOARD_IMU_PER_DEG_S)
/* Maximum ultrasonic range to a wall that presses both bumper switches, mm: 0.04 m and a margin. */
#define NEAR_MM 100u
#define BLOWS 2u
#define UNCHANGED_MM 20
#define UNCHANGED_OVER_M 0.4f
#define INFRARED_UNCHANGED_DMM 30
#define TURN_RAD (PI_F / 3.0f)
#define CREEP_M 0.002f
#define EMPTY_READINGS 5u
#define PRESSED_READINGS 200u /* 10 s */
#define UNSAMPLED_TICKS 50u   /* 0.5 s */
/* Maximum side infrared range to an obstacle in contact on that side, tenths of mm: 0.05 m and a
 * margin. */
#define BESIDE_DMM 800u
#define TICKS_MAX 60000u

#define ENCODERS (SP_FAULT_ENCODER_LEFT | SP_FAULT_ENCODER_RIGHT)
#define BOTH_HALVES (unsigned)(SP_CONTACT_BUMPER_LEFT | SP_CONTACT_BUMPER_RIGHT)

void health_start(health_t *health)
{
    const health_t nothing_known = {0};
    *health = nothing_known;
    health->jolt_ticks = JOLT_TICKS;
    for (unsigned i = 0; i < JOLT_MEAN_TICKS; i++) {
        health->up[i] = GRAVITY_LSB;
    }
    health->up_sum = (int32_t)JOLT_MEAN_TICKS * GRAVITY_LSB;
    health->gravity_sum = (int32_t)GRAVITY_TICKS * GRAVITY_LSB;
    health->sonar_mm = BOARD_NO_RANGE;
    health->side_dmm[0] = health->side_dmm[1] = BOARD_NO_RANGE;
}

static void set(health_t *health, unsigned fault, bool present)
{
    if (present) {
        health->bits = (uint16_t)(health->bits | fault);
    } else {
        health->bits = (uint16_t)(health->bits & ~fault);
    }
}

static void count_up(uint16_t *ticks)
{
    if (*ticks < TICKS_MAX) {
        (*ticks)++;
    }
}

/* Count the consecutive periods in which a condition is true. */
static void count_run(uint16_t *ticks, bool so)
{
    if (so) {
        count_up(ticks);
    } else {
        *ticks = 0;
    }
}

/* ---- each period ---------------------------------------------------------------------------- */

static bool same_registers(const board_imu_t *a, const board_imu_t *b)
{
    return a->accel_x == b->accel_x && a->accel_y == b->accel_y && a->accel_z == b->accel_z
        && a->temperature == b->temperature && a->gyro_x == b->gyro_x && a->gyro_y == b->gyro_y
        && a->gyro_z == b->gyro_z;
}

static bool outside(int32_t value, int32_t limit)
{
    return value > limit || value < -limit;
}

/* Return whether a robot at rest has readings that are impossible at rest. */
static bool implausible_at_rest(const health_t *health, const board_imu_t *imu)
{
    if (health->rest_ticks < REST_TICKS || (health->bits & SP_FAULT_LIFTED)) {
        return false;
    }
    const float x = imu->accel_x;
    const float y = imu->accel_y;
    const float z = imu->accel_z;
    const float square = x * x + y * y + z * z;
    return outside(imu->gyro_x, REST_RATE_LSB) || outside(imu->gyro_y, REST_RATE_LSB)
        || outside(imu->gyro_z, REST_RATE_LSB) || square < GRAVITY_LOW_LSB * GRAVITY_LOW_LSB
        || square > GRAVITY_HIGH_LSB * GRAVITY_HIGH_LSB;
}

static void judge_imu(health_t *health, const board_imu_t *imu, const wheels_t *wheels)
{
    count_run(&health->implausible, implausible_at_rest(health, imu));
    if (health->ticks <= LEARN_TICKS && health->repeats > health->longest_repeat) {
        health->longest_repeat = health->repeats;
    }
    const float apart = wheels_yaw_rate_rad_s(wheels) - (float)imu->gyro_z * GYRO_RAD_S;
    count_run(&health->disagrees,
        health->repeats >= QUIET_TICKS && absolute(apart) > DISAGREE_RAD_S);
    const bool lively = health->ticks > LEARN_TICKS && health->longest_repeat <= LIVELY_TICKS;
    if ((lively && health->repeats >= REPEAT_TICKS) || health->disagrees >= IMPLAUSIBLE_TICKS
        || health->implausible >= IMPLAUSIBLE_TICKS) {
        set(health, SP_FAULT_IMU, true);
    } else if (health->repeats == 0 && health->implausible == 0) {
        set(health, SP_FAULT_IMU, false);
    }
}

static void judge_stall(health_t *health, const wheels_t *wheels)
{
    bool stall = false;
    if (wheels->left.stalled >= STALL_TICKS) {
        if (health->left_ma >= STALL_MA) {
            stall = true;
        } else {
            set(health, SP_FAULT_ENCODER_LEFT, true);
        }
    }
    if (wheels->right.stalled >= STALL_TICKS) {
        if (health->right_ma >= STALL_MA) {
            stall = true;
        } else {
            set(health, SP_FAULT_ENCODER_RIGHT, true);
        }
    }
    set(health, SP_FAULT_MOTOR_STALL, stall);
}

/* Process the acceleration along z; return whether its mean differs much from gravity. */
static bool jolted(health_t *health, int16_t up)
{
    health->up_sum += up - health->up[health->up_place];
    health->up[health->up_place] = up;
    health->up_place = (uint8_t)((health->up_place + 1u) % JOLT_MEAN_TICKS);
    health->gravity_next += up;
    if (++health->gravity_ticks == GRAVITY_TICKS) {
        health->gravity_ticks = 0;
        health->gravity_sum = health->gravity_next;
        health->gravity_next = 0;
    }
    return outside(health->up_sum * JOLT_MEANS - health->gravity_sum, JOLT_SUM);
}

void health_tick(health_t *health, const readings_t *readings, const wheels_t *wheels,
    int16_t left_duty, int16_t right_duty)
{
    const pull_t left = {left_duty, wheels->left.speed_m_s};
    const pull_t right = {right_duty, wheels->right.speed_m_s};
    const board_imu_t *const imu = &readings->imu;
    const bool left_turned = readings->counts.left != health->counts.left;
    const bool right_turned = readings->counts.right != health->counts.right;
    if (left_turned) {
        set(health, SP_FAULT_ENCODER_LEFT, false);
    }
    if (right_turned) {
        set(health, SP_FAULT_ENCODER_RIGHT, false);
    }
    count_run(&health->unsampled, readings->counts.sampled_us == health->counts.sampled_us);
    if (health->unsampled >= UNSAMPLED_TICKS) {
        set(health, ENCODERS, true); /* the speeds are unknown, so the duties must not stay */
    }
    count_run(&health->rest_ticks, !left_turned && !right_turned);
    health->counts = readings->counts;
    count_run(&health->jolt_ticks, !jolted(health, imu->accel_z));
    signs_tick(&health->signs, left, right);
    health->bits = (uint16_t)((health->bits & ~SIGNS_FAULTS) | health->signs.bits);
    count_run(&health->repeats, health->imu_known && same_registers(imu, &health->imu));
    health->imu = *imu;
    health->imu_known = true;
    count_up(&health->ticks);
    if (health->repeats || health->rest_ticks >= REST_TICKS || (health->bits & SP_FAULT_IMU)) {
        judge_imu(health, imu, wheels);
    }
    if (wheels_stalled(wheels) || (health->bits & SP_FAULT_MOTOR_STALL)) {
        judge_stall(health, wheels);
    }
}

/* ---- each reading --------------------------------------------------------------------------- */

void health_power(health_t *health, const board_power_t *power, float low_v, float empty_v)
{
    const float battery_v = (float)power->battery_mv / 1000.0f;
    health->left_ma = power->motor_left_ma;
    health->right_ma = power->motor_right_ma;
    set(health, SP_FAULT_BATTERY_LOW, battery_v < low_v);
    if (!(battery_v < empty_v)) {
        health->empty_readings = 0;
    } else if (health->empty_readings < EMPTY_READINGS) {
        health->empty_readings++;
    }
    health->battery_empty = health->empty_readings >= EMPTY_READINGS;
}

static bool changed(uint16_t now, uint16_t before, int32_t by)
{
    return !seen(now) || !seen(before) || outside((int32_t)now - before, by);
}

static void judge_sonar(health_t *health, const around_t *around, float ahead_m, float turned_rad)
{
    const uint16_t sonar_mm = around->ranges.ultrasonic_mm;
    const bool touched = (around->contacts & BOTH_HALVES) == BOTH_HALVES;
    if (touched && !health->touched) {
        if (seen(sonar_mm) && sonar_mm <= NEAR_MM) {
            health->blows = 0;
        } else if (health->blows < BLOWS) {
            health->blows++;
        }
    }
    health->touched = touched;
    if (changed(sonar_mm, health->sonar_mm, UNCHANGED_MM)) {
        if (seen(sonar_mm) && seen(health->sonar_mm)) {
            health->blows = 0;
        }
        health->sonar_mm = sonar_mm;
        health->unseen_m = 0.0f;
    } else if (sonar_mm > NEAR_MM && !touched && absolute(turned_rad) <= 0.5f * absolute(ahead_m)) {
        health->unseen_m += larger(0.0f, ahead_m);
    }
    set(health, SP_FAULT_ULTRASONIC,
        health->blows >= BLOWS || health->unseen_m >= UNCHANGED_OVER_M);
}

static void judge_side(
    health_t *health, unsigned side, uint16_t range_dmm, float ahead_m, float turned_rad)
{
    const uint16_t before_dmm = health->side_dmm[side];
    if (changed(range_dmm, before_dmm, INFRARED_UNCHANGED_DMM) || absolute(ahead_m) > CREEP_M) {
        health->side_dmm[side] = range_dmm;
        if (range_dmm != before_dmm) {
            health->side_rad[side] = 0.0f;
        }
    } else {
        health->side_rad[side] += absolute(turned_rad);
    }
}

/* Return whether a switch is pressed for a long time without other evidence of contact. */
static bool switch_stays(health_t *health, const around_t *around)
{
    static const uint8_t halves[2] = {SP_CONTACT_BUMPER_LEFT, SP_CONTACT_BUMPER_RIGHT};
    const uint16_t beside_dmm[2] = {
        around->ranges.infrared_left_dmm, around->ranges.infrared_right_dmm};
    const bool felt = around->ranges.ultrasonic_mm <= NEAR_MM
        || (health->bits & SP_FAULT_MOTOR_STALL) != 0;
    bool stays = false;
    for (unsigned side = 0; side < 2u; side++) {
        uint8_t *const pressed = &health->pressed[side];
        if (!(around->contacts & halves[side]) || felt || beside_dmm[side] <= BESIDE_DMM) {
            *pressed = 0;
        } else if (*pressed < PRESSED_READINGS) {
            (*pressed)++;
        }
        stays = stays || *pressed >= PRESSED_READINGS;
    }
    return stays;
}

void health_around(health_t *health, const around_t *around, float wheel_base_m,
    float metres_per_count, bool has_ultrasonic)
{
    const float left =
        wrapped16((uint16_t)(health->counts.left - health->range_counts.left));
    const float right =
        wrapped16((uint16_t)(health->counts.right - health->range_counts.right));
    const float ahead_m = 0.5f * (left + right) * metres_per_count;
    const float turned_rad = (right - left) * metres_per_count / wheel_base_m;
    health->range_counts = health->counts;
    if (!(around->contacts & SP_CONTACT_CLIFF)) {
        set(health, SP_FAULT_LIFTED, false);
    } else if (health->jolt_ticks < JOLT_TICKS) {
        set(health, SP_FAULT_LIFTED, true);
    }
    set(health, SP_FAULT_BUMPER, switch_stays(health, around));
    if (has_ultrasonic) {
        judge_sonar(health, around, ahead_m, turned_rad);
    }
    judge_side(health, 0, around->ranges.infrared_left_dmm, ahead_m, turned_rad);
    judge_side(health, 1, around->ranges.infrared_right_dmm, ahead_m, turned_rad);
    set(health, SP_FAULT_INFRARED,
        health->side_rad[0] >= TURN_RAD || health->side_rad[1] >= TURN_RAD);
}

const char *health_stopping(const health_t *health)
{
    if (health->bits & SP_FAULT_LIFTED) {
        return "lifted";
    }
    if (health->bits & (ENCODERS | SIGNS_FAULTS)) {
        return "encoder";
    }
    return health->battery_empty ? "battery empty" : NULL;
}

bool health_burning(const wheels_t *wheels)
{
    return wheels_stalled(wheels) >= STALL_STOP_TICKS;
}

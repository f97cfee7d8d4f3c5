#include "signs.h"

#include "numbers.h"

/* Minimum duty that turns a wheel. The dead band ends at 1500 with a full battery, and at 2000 with
 * an empty battery. */
#define DRIVEN 2000
#define NOT_DRIVEN 500
#define TURNS_M_S 0.03f /* two counts per period */
#define STANDS_M_S 0.005f
/* Number of consecutive periods with counts against the duty that set a fault. A wheel that changes
 * its direction may turn against its new duty for 3 periods. With reversed encoders, the robot
 * travels 5 cm out of control before the fault is set. */
#define AGAINST_TICKS 15u
#define ALSO_TICKS 5u   /* minimum number of such periods of the other wheel, for a fault of both wheels */
/* Number of periods against the duty that set a fault of one wheel while the other wheel counts
 * correctly. With swapped encoders on a straight path, the second wheel begins
 * to count against its duty 0.1 s after the first wheel, so a shorter time would report one
 * reversed encoder. */
#define ALONE_TICKS 25u
#define AGREES_TICKS 30u /* periods with counts in the duty's direction that clear a fault */

static void count_run(uint8_t *ticks, bool so)
{
    if (!so) {
        *ticks = 0;
    } else if (*ticks < AGREES_TICKS) {
        (*ticks)++;
    }
}

static void side_tick(side_t *side, pull_t pull, pull_t other)
{
    const bool ahead = pull.duty > 0;
    const bool driven = (pull.duty >= DRIVEN || pull.duty <= -DRIVEN) && ahead == side->was_ahead;
    const float along_m_s = ahead ? pull.speed_m_s : -pull.speed_m_s;
    const float other_m_s = ahead ? other.speed_m_s : -other.speed_m_s;
    const int16_t other_along = (int16_t)(ahead ? other.duty : -other.duty);
    const bool other_idle = other.duty <= NOT_DRIVEN && other.duty >= -NOT_DRIVEN;
    const bool with_it = driven && along_m_s >= TURNS_M_S;
    side->was_ahead = ahead;
    count_run(&side->against, driven && along_m_s <= -TURNS_M_S);
    count_run(&side->agrees, with_it);
    count_run(&side->own, with_it && other_along <= NOT_DRIVEN);
    count_run(&side->crossed,
        driven && absolute(along_m_s) < STANDS_M_S && other_idle && other_m_s >= TURNS_M_S);
}

/* Clear a fault when counts have agreed with duties long enough, also in bring-up mode. */
static void clear_agreeing(signs_t *signs)
{
    unsigned gone = 0;
    if (signs->left.agrees >= AGREES_TICKS) {
        gone |= SP_FAULT_ENCODER_LEFT_REVERSED;
    }
    if (signs->right.agrees >= AGREES_TICKS) {
        gone |= SP_FAULT_ENCODER_RIGHT_REVERSED;
    }
    if (signs->left.own >= AGREES_TICKS || signs->right.own >= AGREES_TICKS) {
        gone |= SP_FAULT_ENCODERS_SWAPPED;
    }
    signs->bits = (uint16_t)(signs->bits & ~gone);
}

static uint16_t verdict(const side_t *left, const side_t *right)
{
    if (left->crossed >= AGREES_TICKS || right->crossed >= AGREES_TICKS) {
        return SP_FAULT_ENCODERS_SWAPPED;
    }
    if (left->against < AGAINST_TICKS && right->against < AGAINST_TICKS) {
        return 0;
    }
    if (left->against >= ALSO_TICKS && right->against >= ALSO_TICKS) {
        return left->was_ahead != right->was_ahead
            ? SP_FAULT_ENCODERS_SWAPPED
            : SP_FAULT_ENCODER_LEFT_REVERSED | SP_FAULT_ENCODER_RIGHT_REVERSED;
    }
    if (left->against >= ALONE_TICKS) {
        return SP_FAULT_ENCODER_LEFT_REVERSED;
    }
    return right->against >= ALONE_TICKS ? SP_FAULT_ENCODER_RIGHT_REVERSED : 0u;
}

void signs_tick(signs_t *signs, pull_t left, pull_t right)
{
    side_tick(&signs->left, left, right);
    side_tick(&signs->right, right, left);
    if (signs->bits != 0) {
        clear_agreeing(signs);
    } else {
        signs->bits = verdict(&signs->left, &signs->right);
    }
}

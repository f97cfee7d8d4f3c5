/* Legs: what a planner asks for, one after the other, and how each ended. */
#ifndef LEG_H
#define LEG_H

#include <stdbool.h>

#include "pose.h"

typedef enum {
    LEG_NONE,
    LEG_TURN,  /* in place to a heading, the short way */
    LEG_DRIVE, /* along a heading from where it stands */
    LEG_GO_TO, /* to a point in a straight line, turning in place first if it lies off the bow */
    LEG_REST   /* stand still, which measures the gyro's bias */
} leg_kind_t;

typedef struct {
    leg_kind_t kind;
    const char *purpose; /* for log lines */
    float heading_rad;   /* turn, drive */
    bool bounded;        /* drive: `distance_m` ends it */
    float distance_m;    /* along the heading; negative: backwards */
    float speed_m_s;     /* drive; 0: cruise speed */
    float stop_range_m;  /* drive, go to: the ultrasonic reading that ends it; 0: none does */
    float x_m, y_m;      /* go to */
    float duration_s;    /* rest */
} leg_t;

typedef enum {
    END_NONE,     /* it is under way */
    END_DONE,     /* the heading or the point was reached, or the rest is over */
    END_DISTANCE, /* the distance was driven */
    END_RANGE,    /* the ultrasonic read the stop range */
    END_BUMPER,
    END_CLIFF,
    END_STALLED, /* commanded to move, and the estimate did not */
    END_TIMEOUT
} leg_end_t;

/* How a leg ended, after the robot came to rest. */
typedef struct {
    leg_end_t reason;
    float distance_m; /* along the leg's line, signed as the leg's; 0 for a turn */
    pose_t pose;
} leg_result_t;

/* Whether something in the world ended it, not its own goal. */
static inline bool leg_blocked(leg_end_t reason)
{
    return reason != END_DONE && reason != END_DISTANCE;
}

const char *leg_end_name(leg_end_t reason);

#endif

/* Legs: the motion primitives that a planner requests one by one, and the result of each. */
#ifndef LEG_H
#define LEG_H

#include <stdbool.h>

#include "pose.h"

typedef enum {
    LEG_NONE,
    LEG_TURN, /* turn in place to a heading, in the shorter direction */
    LEG_DRIVE, /* drive along a heading from the present place */
    LEG_GO_TO, /* drive straight to a point, after a turn in place if the point is not ahead */
    LEG_REST   /* stand still, for example to measure the gyro bias */
} leg_kind_t;

typedef struct {
    leg_kind_t kind;
    const char *purpose; /* for log lines */
    float heading_rad;   /* turn, drive */
    bool bounded;        /* drive: the leg ends after `distance_m` */
    float distance_m;    /* distance along the heading; negative: backwards */
    float speed_m_s;     /* drive; 0: cruise speed */
    float stop_range_m;  /* drive, go to: ultrasonic range that ends the leg; 0: none */
    float x_m, y_m;      /* go to */
    float duration_s;    /* rest */
} leg_t;

typedef enum {
    END_NONE,     /* in progress */
    END_DONE,     /* the heading or the point was reached, or the rest has ended */
    END_DISTANCE, /* the distance was driven */
    END_RANGE,    /* the ultrasonic range reached the stop range */
    END_BUMPER,
    END_CLIFF,
    END_STALLED, /* the estimate did not move despite the command */
    END_TIMEOUT
} leg_end_t;

/* Result of a leg after the robot has come to rest. */
typedef struct {
    leg_end_t reason;
    float distance_m; /* distance along the leg's line, with the sign of the leg's distance; 0 for a
                         turn */
    pose_t pose;
} leg_result_t;

/* Return whether an obstacle ended the leg before its goal. */
static inline bool leg_blocked(leg_end_t reason)
{
    return reason != END_DONE && reason != END_DISTANCE;
}

const char *leg_end_name(leg_end_t reason);

#endif

/* Planar poses and angles, in metres and radians. Headings are counter-clockwise from +x. */
#ifndef POSE_H
#define POSE_H

#include <math.h>

#include "numbers.h"

typedef struct {
    float x_m;
    float y_m;
    float heading_rad;
} pose_t;

/* Return the angle wrapped to -pi .. pi. */
static inline float wrapped(float angle_rad)
{
    return angle_rad - 2.0f * PI_F * floorf((angle_rad + PI_F) / (2.0f * PI_F));
}

static inline float distance_m(const pose_t *a, const pose_t *b)
{
    return hypotf(b->x_m - a->x_m, b->y_m - a->y_m);
}

#endif

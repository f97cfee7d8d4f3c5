/* The robot as described by the parameters in effect. */
#ifndef MODEL_H
#define MODEL_H

#include "parameters.h"

typedef struct {
    float diameter_m;
    float cleaning_width_m;
    float mouth_offset_m;
    float wheel_base_m;
    float metres_per_count; /* wheel travel of one encoder count: eq. 3 of the paper with N = 1 */
    float gyro_bias_rad_s; /* yaw rate reading at rest; each plan measures it again */
    float wheel_ratio; /* right wheel's diameter divided by the left wheel's diameter; the mean is
                          the diameter */
    float cruise_speed_m_s;
    float max_speed_m_s;
    float max_yaw_rate_rad_s;
} model_t;

void model_apply(model_t *model, const parameters_t *parameters);

#endif

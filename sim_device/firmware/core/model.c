#include "model.h"

#include "numbers.h"

void model_apply(model_t *model, const parameters_t *parameters)
{
    model->diameter_m = parameters_value(parameters, PARAMETER_ROBOT_DIAMETER);
    model->cleaning_width_m = parameters_value(parameters, PARAMETER_CLEANING_WIDTH);
    model->mouth_offset_m = parameters_value(parameters, PARAMETER_MOUTH_OFFSET);
    model->wheel_base_m = parameters_value(parameters, PARAMETER_WHEEL_BASE);
    model->metres_per_count = PI_F * parameters_value(parameters, PARAMETER_WHEEL_DIAMETER)
        / parameters_value(parameters, PARAMETER_COUNTS_PER_TURN);
    model->gyro_bias_rad_s = parameters_value(parameters, PARAMETER_GYRO_BIAS);
    model->wheel_ratio = parameters_value(parameters, PARAMETER_WHEEL_RATIO);
    model->cruise_speed_m_s = parameters_value(parameters, PARAMETER_CRUISE_SPEED);
    model->max_speed_m_s = parameters_value(parameters, PARAMETER_MAX_SPEED);
    model->max_yaw_rate_rad_s = parameters_value(parameters, PARAMETER_MAX_YAW_RATE);
}

"""State estimation: pose, gyro bias and walls from encoders, gyro and range sensors."""

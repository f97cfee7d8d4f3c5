/* Model of an MPU6050 with its registers on the virtual board's I2C bus (InvenSense RM-MPU-6000A).
 */
#ifndef MPU6050_H
#define MPU6050_H

#include <stdbool.h>
#include <stdint.h>

#define MPU6050_DIVIDER 0x19u
#define MPU6050_CONFIG 0x1Au
#define MPU6050_GYRO_CONFIG 0x1Bu
#define MPU6050_ACCEL_CONFIG 0x1Cu
#define MPU6050_INT_STATUS 0x3Au
#define MPU6050_DATA 0x3Bu /* acceleration, temperature, rotation: 14 B, high byte first */
#define MPU6050_POWER 0x6Bu
#define MPU6050_WHO_AM_I 0x75u
#define MPU6050_DATA_BYTES 14u
#define MPU6050_REGISTERS 0x76u

typedef struct {
    uint8_t registers[MPU6050_REGISTERS];
} mpu6050_t;

/* Set the state after power-on: sleep mode, and the reset values of the registers. */
void mpu6050_power_on(mpu6050_t *imu);

/* Write one register, or read consecutive registers. Registers that do not exist read as 0. */
void mpu6050_write(mpu6050_t *imu, uint8_t number, uint8_t value);
void mpu6050_read(mpu6050_t *imu, uint8_t number, uint8_t *out, unsigned length);

/* Store a new sample: seven counts in the chip's order. It has no effect in sleep mode. */
void mpu6050_convert(mpu6050_t *imu, const int16_t counts[7]);

#endif

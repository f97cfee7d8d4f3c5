/* The board with an STM32F429IGT6 (LQFP176): which pin is what, and its parts towards each other.
 * Pins and alternate functions: data sheet DS9405 (STM32F427xx/429xx), tables 10 and 12.
 *
 *   PA9  PA10      USART1 TX, RX (AF7): the line to the host, 921 600 baud 8N1
 *   PB8  PB9       CAN1 RX, TX (AF9), to a transceiver
 *   PG0            to ground: the host is on the CAN bus, not on the UART
 *   PA6  PA7       TIM3 CH1, CH2 (AF2): left encoder A, B
 *   PD12 PD13      TIM4 CH1, CH2 (AF2): right encoder A, B
 *   PE9  PE11      TIM1 CH1, CH2 (AF1): L298N IN1, IN2, the left motor
 *   PE13 PE14      TIM1 CH3, CH4 (AF1): L298N IN3, IN4, the right motor
 *   PE8  PE10      L298N ENA, ENB
 *   PB6  PB7       I2C1 SCL, SDA (AF4): MPU6050, address 0x68; its INT on PB5
 *   PA4            HC-SR04 trigger
 *   PA0            TIM5 CH1 (AF2): its echo, divided to 3.3 V
 *   PC1  PC2       ADC 11, 12: infrared left, right (GP2Y0A41SK0F)
 *   PC3  PC4       ADC 13, 14: battery, 5 V rail, over their dividers
 *   PC5  PB0       ADC 15, 8: motor currents left, right, from shunt amplifiers
 *   PF0 PF1 PF2    cliff sensors, high where the floor is missing (so is a broken wire)
 *   PF3 PF4        bumper switches left, right, to ground where pressed
 *
 * Interrupt priorities: 2 the line, 4 IMU, 5 echo, 6 flash, 8 the millisecond. */
#ifndef F429_H
#define F429_H

#include <stdbool.h>
#include <stdint.h>

#include "board.h"
#include "stm32f4.h"

#ifndef BOARD_HSE_MHZ
#define BOARD_HSE_MHZ 25u /* of the crystal */
#endif
#ifndef BOARD_NODE
#define BOARD_NODE 1u
#endif
#ifndef BOARD_BAUD
#define BOARD_BAUD 921600u
#endif

#define CORE_HZ 168000000u
#define APB1_HZ (CORE_HZ / 4u)
#define APB2_HZ (CORE_HZ / 2u)
#define TIMER_APB1_HZ (2u * APB1_HZ) /* RM0090 6.2: twice the bus where that is divided */
#define TIMER_APB2_HZ (2u * APB2_HZ)

enum { PORT_A, PORT_B, PORT_C, PORT_D, PORT_E, PORT_F, PORT_G };
enum { LEVEL_LINE = 2, LEVEL_IMU = 4, LEVEL_ECHO = 5, LEVEL_FLASH = 6, LEVEL_TICK = 8 };

/* The device that the interrupts hand what they receive to. */
extern firmware_t *device;

static inline uint32_t uptime_us(void) { return TIM2->cnt; }

typedef enum { PULL_NONE, PULL_UP, PULL_DOWN } pull_t;
void pin_input(unsigned port, unsigned pin, pull_t pull);
void pin_output(unsigned port, unsigned pin);
void pin_alternate(unsigned port, unsigned pin, unsigned function, pull_t pull, bool open_drain);
void pin_analog(unsigned port, unsigned pin);
void pin_write(unsigned port, unsigned pin, bool high);
bool pin_read(unsigned port, unsigned pin);

void clocks_start(void);
uint8_t reset_cause(void);
uint32_t boot_id(const uint8_t uid[12]);

void uart_start(void);
bool uart_drained(void);
void can_start(uint8_t node);
void motors_start(void);
void encoders_start(void);
void imu_start(void);
void imu_millisecond(uint32_t now_us); /* from the tick's interrupt */
void sonar_start(void);
void sonar_millisecond(void); /* likewise */
uint16_t sonar_mm(void);
void analog_start(void);

enum {
    ANALOG_INFRARED_LEFT,
    ANALOG_INFRARED_RIGHT,
    ANALOG_BATTERY,
    ANALOG_LOGIC,
    ANALOG_MOTOR_LEFT,
    ANALOG_MOTOR_RIGHT,
    ANALOG_COUNT
};
/* Mean of the last ANALOG_SETS conversions, millivolts at the pin. */
uint32_t analog_mv(unsigned channel);
#define ANALOG_AGE_US 1500u /* of that mean: half of the time over which it is taken */

#endif

/* Configuration of the robot's own board: STM32F429IGT6 (LQFP176), 1 MB of flash, a 25 MHz crystal.
 * Pins and alternate functions (AF): data sheet DS9405 (STM32F427xx/429xx), tables 10 and 12. Each
 * pin is given as port and number. */
#ifndef BOARD_CONFIG_H
#define BOARD_CONFIG_H

#define BOARD_NAME "firmware on an STM32F429"
/* Parts that are connected to the board. With fewer parts, set -DBOARD_CAPABILITIES=... */
#ifndef BOARD_CAPABILITIES
#define BOARD_CAPABILITIES                                                                       \
    (SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU | SP_CAPABILITY_ULTRASONIC |                     \
     SP_CAPABILITY_INFRARED | SP_CAPABILITY_BUMPER | SP_CAPABILITY_CLIFF)
#endif

#ifndef BOARD_HSE_MHZ
#define BOARD_HSE_MHZ 25u /* of the crystal */
#endif
#define BOARD_HSE_BYPASS 0 /* 0: a crystal, not an external clock */

/* The serial link: USART1 (AF7), with DMA2 streams from RM0090, table 43. */
#define LINK_UART USART1
#define LINK_UART_HZ APB2_HZ
#define LINK_UART_APB1 0u
#define LINK_UART_APB2 RCC_APB2_USART1
#define LINK_UART_IRQ IRQ_USART1
#define LINK_TX PORT_A, 9
#define LINK_RX PORT_A, 10
#define LINK_DMA DMA2
#define LINK_RX_STREAM 2u
#define LINK_RX_IRQ IRQ_DMA2_STREAM2
#define LINK_TX_STREAM 7u
#define LINK_TX_IRQ IRQ_DMA2_STREAM7
#define LINK_DMA_CHANNEL 4u

/* If this pin is connected to ground, the host link is the CAN bus instead of the UART. */
#define CAN_SELECT PORT_G, 0
#define CAN_RX PORT_B, 8 /* CAN1 (AF9), to a transceiver */
#define CAN_TX PORT_B, 9

#define ENCODER_LEFT_A PORT_A, 6 /* TIM3 CH1, CH2 (AF2) */
#define ENCODER_LEFT_B PORT_A, 7
#define ENCODER_RIGHT_A PORT_D, 12 /* TIM4 CH1, CH2 (AF2) */
#define ENCODER_RIGHT_B PORT_D, 13

#define IMU_SCL PORT_B, 6 /* I2C1 (AF4): MPU6050, address 0x68 */
#define IMU_SDA PORT_B, 7

/* Port, pin and ADC1 channel of each analog input: infrared left and right (GP2Y0A41SK0F); battery
 * and 5 V rail, behind voltage dividers; motor currents left and right, from shunt amplifiers. */
#define ANALOG_INPUTS                                                                            \
    {{PORT_C, 1, 11}, {PORT_C, 2, 12}, {PORT_C, 3, 13},                                          \
     {PORT_C, 4, 14}, {PORT_C, 5, 15}, {PORT_B, 0, 8}}

#endif

/* Configuration of the NUCLEO-F429ZI (ST, MB1137): STM32F429ZIT6 (LQFP144), 2 MB of flash; the
 * ST-LINK on the board provides clock and serial link. Connectors and solder bridges: UM1974. Pins
 * and alternate functions (AF): data sheet DS9405 (STM32F427xx/429xx), tables 10 and 12. Each pin
 * is given as port and number.
 *
 * The firmware does not use the pins that the board itself uses: Ethernet on PA1, PA2, PA7, PB13,
 * PC1, PC4, PC5, PG11, PG13; USB on PA8 to PA12; LEDs on PB0, PB7, PB14; the button on PC13. */
#ifndef BOARD_CONFIG_H
#define BOARD_CONFIG_H

#define BOARD_NAME "firmware on a NUCLEO-F429ZI"
/* Parts that are connected to the board. With fewer parts, set -DBOARD_CAPABILITIES=... */
#ifndef BOARD_CAPABILITIES
#define BOARD_CAPABILITIES                                                                       \
    (SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU | SP_CAPABILITY_ULTRASONIC |                     \
     SP_CAPABILITY_INFRARED | SP_CAPABILITY_BUMPER | SP_CAPABILITY_CLIFF)
#endif

#undef BOARD_HSE_MHZ       /* given for a bare chip; this clock is fixed */
#define BOARD_HSE_MHZ 8u   /* the ST-LINK's MCO */
#define BOARD_HSE_BYPASS 1 /* 1: an external clock (UM1974 6.7.1, as delivered) */

/* The serial link: USART3 (AF7) to the ST-LINK's virtual port, with DMA1 streams from RM0090, table
 * 42. */
#define LINK_UART USART3
#define LINK_UART_HZ APB1_HZ
#define LINK_UART_APB1 RCC_APB1_USART3
#define LINK_UART_APB2 0u
#define LINK_UART_IRQ IRQ_USART3
#define LINK_TX PORT_D, 8
#define LINK_RX PORT_D, 9
#define LINK_DMA DMA1
#define LINK_RX_STREAM 1u
#define LINK_RX_IRQ IRQ_DMA1_STREAM1
#define LINK_TX_STREAM 3u
#define LINK_TX_IRQ IRQ_DMA1_STREAM3
#define LINK_DMA_CHANNEL 4u

/* If this pin is connected to ground, the host link is the CAN bus instead of the UART. */
#define CAN_SELECT PORT_G, 0
#define CAN_RX PORT_D, 0 /* CAN1 (AF9), to a transceiver */
#define CAN_TX PORT_D, 1

#define ENCODER_LEFT_A PORT_C, 6 /* TIM3 CH1, CH2 (AF2) */
#define ENCODER_LEFT_B PORT_C, 7
#define ENCODER_RIGHT_A PORT_D, 12 /* TIM4 CH1, CH2 (AF2) */
#define ENCODER_RIGHT_B PORT_D, 13

#define IMU_SCL PORT_B, 8 /* I2C1 (AF4), D15 and D14: MPU6050, address 0x68 */
#define IMU_SDA PORT_B, 9

/* Port, pin and ADC1 channel of each analog input: infrared left and right (GP2Y0A41SK0F); battery
 * and 5 V rail, behind voltage dividers; motor currents left and right, from shunt amplifiers. */
#define ANALOG_INPUTS                                                                            \
    {{PORT_A, 3, 3}, {PORT_C, 0, 10}, {PORT_C, 3, 13},                                           \
     {PORT_C, 2, 12}, {PORT_B, 1, 9}, {PORT_A, 5, 5}}

#endif

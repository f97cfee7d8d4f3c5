/* The firmware as a program on this computer, in real time. The serial link is a pseudo-terminal.
 * The simulated robot has two motors with a first-order lag, on a floor without walls. The program
 * prints `ready PORT` and runs until SIGTERM or SIGINT.
 *
 *     make -C sim_device/firmware host && sim_device/firmware/build/desk
 *     sweepctl connect PORT
 */
#define _XOPEN_SOURCE 600
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "firmware.h"

#define SUPPLY_V 16.0
#define LOST_V 2.4 /* voltage lost in the bridge and by friction */
#define BACK_EMF_V_S 1.10
#define MOTOR_LAG_S 0.05
#define WHEEL_RADIUS_M 0.0325
#define WHEEL_BASE_M 0.23
#define COUNTS_PER_RAD (1560.0 / 6.283185307179586)
#define GYRO_PER_RAD_S 7505.75 /* 131 counts per deg/s */
#define ONE_G 16384
#define PAGE BOARD_FLASH_PAGE_SIZE

static firmware_t *device;
static int master = -1;
static volatile sig_atomic_t ended;
static uint64_t booted_us;
static uint64_t slept_us;
static uint64_t moved_us;
static bool drivers_on;
static double duty[2], speed_rad_s[2], angle_rad[2];
static uint8_t pages[BOARD_FLASH_PAGES][PAGE];
static uint64_t flash_until_us;
static board_identity_t identity = {.node = 1, 
    .capabilities = SP_CAPABILITY_ENCODERS | SP_CAPABILITY_IMU,
    .name = "sweeper on a desk"};

static uint64_t clock_us(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

/* ---- the chip ------------------------------------------------------------------------------- */

static void end(int number)
{
    (void)number;
    ended = 1;
}

static void begin_boot(uint8_t reset_cause)
{
    booted_us = clock_us();
    slept_us = 0;
    identity.boot_id = ((uint32_t)(booted_us * 2654435761u) ^ (uint32_t)getpid() << 16) | 1u;
    identity.reset_cause = reset_cause;
}

void board_start(firmware_t *firmware)
{
    device = firmware;
    struct termios raw;
    master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0) {
        perror("no pseudo-terminal");
        exit(1);
    }
    const int slave = open(ptsname(master), O_RDWR | O_NOCTTY); /* keeps the pseudo-terminal open */
    if (slave < 0 || tcgetattr(slave, &raw) != 0) {
        perror("no pseudo-terminal");
        exit(1);
    }
    raw.c_iflag &= (tcflag_t) ~(BRKINT | ICRNL | INLCR | IGNCR | INPCK | ISTRIP | IXON);
    raw.c_oflag &= (tcflag_t)~OPOST;
    raw.c_lflag &= (tcflag_t) ~(ECHO | ECHONL | ICANON | IEXTEN | ISIG);
    raw.c_cflag = (raw.c_cflag & (tcflag_t) ~(CSIZE | PARENB)) | CS8;
    (void)tcsetattr(slave, TCSANOW, &raw);
    (void)fcntl(master, F_SETFL, O_NONBLOCK);
    (void)signal(SIGTERM, end);
    (void)signal(SIGINT, end);
    memset(pages, 0xFF, sizeof pages);
    memcpy(identity.uid, "on a desk 01", sizeof identity.uid);
    moved_us = clock_us();
    begin_boot(SP_RESET_CAUSE_POWER_ON);
    printf("ready %s\n", ptsname(master));
    (void)fflush(stdout);
}

static uint32_t uptime_us(void)
{
    return (uint32_t)(clock_us() - booted_us);
}

uint32_t board_now_us(board_t *board)
{
    return uptime_us();
}

uint32_t board_busy_us(board_t *board)
{
    return (uint32_t)(clock_us() - booted_us - slept_us);
}

void board_idle(void)
{
    struct pollfd line = {.fd = master, .events = POLLIN};
    uint8_t bytes[256];
    const uint64_t before_us = clock_us();
    (void)poll(&line, 1, 1);
    slept_us += clock_us() - before_us;
    const ssize_t got = read(master, bytes, sizeof bytes);
    if (got > 0) {
        firmware_uart_received(device, bytes, (size_t)got, uptime_us());
    }
    if (ended) {
        exit(0);
    }
}

void board_watchdog_feed(board_t *board)
{
}

void board_reboot(board_t *board)
{
    begin_boot(SP_RESET_CAUSE_SOFTWARE);
    firmware_boot(device, board);
}

const board_identity_t *board_identity(board_t *board)
{
    return &identity;
}

/* ---- the line ------------------------------------------------------------------------------- */

size_t board_uart_room(board_t *board)
{
    return 4096;
}

void board_uart_write(board_t *board, const uint8_t *data, size_t length)
{
    const ssize_t sent = write(master, data, length);
    (void)sent; /* without a host, bytes are lost, as on a UART */
}

uint32_t board_uart_wait_us(board_t *board)
{
    return 0;
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame)
{
    (void)frame; /* this board has no CAN bus */
    return true;
}

void board_can_health(board_t *board, board_can_health_t *out)
{
    memset(out, 0, sizeof *out);
}

/* ---- the robot ------------------------------------------------------------------------------ */

static void move(void)
{
    const uint64_t now_us = clock_us();
    const double dt_s = (double)(now_us - moved_us) * 1e-6;
    const double share = exp(-dt_s / MOTOR_LAG_S);
    moved_us = now_us;
    for (int i = 0; i < 2; i++) {
        const double pull_v = drivers_on ? fabs(duty[i]) * SUPPLY_V - LOST_V : 0.0;
        const double wanted = pull_v > 0.0 ? copysign(pull_v, duty[i]) / BACK_EMF_V_S : 0.0;
        const double before = speed_rad_s[i];
        speed_rad_s[i] = wanted + (before - wanted) * share;
        angle_rad[i] += wanted * dt_s + (before - speed_rad_s[i]) * MOTOR_LAG_S;
    }
}

void board_motors(board_t *board, int16_t left, int16_t right)
{
    move();
    duty[0] = left / (double)BOARD_DUTY_ONE;
    duty[1] = right / (double)BOARD_DUTY_ONE;
}

void board_drivers(board_t *board, bool enabled)
{
    move();
    drivers_on = enabled;
}

void board_encoders(board_t *board, board_encoders_t *out)
{
    move();
    out->left = (uint16_t)(int64_t)floor(angle_rad[0] * COUNTS_PER_RAD);
    out->right = (uint16_t)(int64_t)floor(angle_rad[1] * COUNTS_PER_RAD);
    out->sampled_us = uptime_us();
}

void board_imu(board_t *board, board_imu_t *out)
{
    const board_imu_t level = {.accel_z = ONE_G, .sampled_us = uptime_us()};
    const double yaw_rad_s = (speed_rad_s[1] - speed_rad_s[0]) * WHEEL_RADIUS_M / WHEEL_BASE_M;
    *out = level;
    out->gyro_z = (int16_t)lround(fmax(-32768.0, fmin(32767.0, yaw_rad_s * GYRO_PER_RAD_S)));
}

void board_ranges(board_t *board, board_ranges_t *out)
{
    const board_ranges_t nothing = {
        BOARD_NO_RANGE, BOARD_NO_RANGE, BOARD_NO_RANGE, uptime_us(), uptime_us()};
    *out = nothing;
}

uint8_t board_contacts(board_t *board)
{
    return 0;
}

static uint16_t current_ma(int wheel)
{
    return (uint16_t)(62.0 + 40.0 * fabs(speed_rad_s[wheel]));
}

void board_power(board_t *board, board_power_t *out)
{
    out->battery_mv = 15900;
    out->logic_mv = 5000;
    out->motor_left_ma = current_ma(0);
    out->motor_right_ma = current_ma(1);
    out->sampled_us = uptime_us();
}

/* ---- flash ---------------------------------------------------------------------------------- */

const uint8_t *board_flash_page(board_t *board, unsigned page)
{
    return pages[page];
}

void board_flash_erase(board_t *board, unsigned page)
{
    memset(pages[page], 0xFF, PAGE);
    flash_until_us = clock_us() + 250000u;
}

void board_flash_write(board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length)
{
    memcpy(pages[page] + offset, data, length);
    flash_until_us = clock_us() + 1000u;
}

bool board_flash_busy(board_t *board)
{
    return clock_us() < flash_until_us;
}

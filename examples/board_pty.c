/* The example's board on a desk: the serial line is a pseudo-terminal, the robot a pair of ideal
 * wheels on an endless floor. It prints `ready PORT` and runs until SIGTERM or SIGINT.
 *
 *     cc -std=c99 -Iwire -Iexamples examples/device_main.c examples/board_pty.c \
 *         wire/sweepctl_protocol.c -o device && ./device
 *     sweepctl connect PORT
 */
#define _XOPEN_SOURCE 600
#include "board.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define WHEEL_BASE_M 0.23f
#define COUNTS_PER_M 7639.4f /* 1560 counts a turn of a 65 mm wheel */
#define GYRO_PER_RAD_S 7505.75f
#define ONE_G 16384

static int master = -1;
static int slave = -1;
static volatile sig_atomic_t ended;
static float v_m_s, yaw_rate_rad_s, left_counts, right_counts;
static uint32_t moved_us;

static void end(int number)
{
    (void)number;
    ended = 1;
}

static void open_line(void)
{
    struct termios raw;
    master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0) {
        perror("no pseudo-terminal");
        exit(1);
    }
    slave = open(ptsname(master), O_RDWR | O_NOCTTY); /* open: the line outlives listeners */
    if (slave < 0 || tcgetattr(slave, &raw) != 0) {
        perror("no pseudo-terminal");
        exit(1);
    }
    raw.c_iflag &= (tcflag_t)~(BRKINT | ICRNL | INLCR | IGNCR | INPCK | ISTRIP | IXON);
    raw.c_oflag &= (tcflag_t)~OPOST;
    raw.c_lflag &= (tcflag_t)~(ECHO | ECHONL | ICANON | IEXTEN | ISIG);
    raw.c_cflag = (raw.c_cflag & (tcflag_t)~(CSIZE | PARENB)) | CS8;
    (void)tcsetattr(slave, TCSANOW, &raw);
    (void)fcntl(master, F_SETFL, O_NONBLOCK);
    (void)signal(SIGTERM, end);
    (void)signal(SIGINT, end);
    printf("ready %s\n", ptsname(master));
    (void)fflush(stdout);
}

bool board_wait(void)
{
    struct pollfd line;
    if (master < 0) {
        open_line();
    }
    line.fd = master;
    line.events = POLLIN;
    line.revents = 0;
    (void)poll(&line, 1, 1);
    return !ended;
}

uint32_t board_time_us(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u);
}

size_t board_read(uint8_t *data, size_t room)
{
    const ssize_t got = read(master, data, room);
    return got > 0 ? (size_t)got : 0;
}

void board_write(const uint8_t *data, size_t length)
{
    /* Without a listener, bytes are lost, as on a wire. */
    const ssize_t sent = write(master, data, length);
    (void)sent;
}

bool board_line_idle(void)
{
    return true;
}

void board_uid(uint8_t uid[12])
{
    memcpy(uid, "desk example", 12);
}

uint32_t board_random(void)
{
    return board_time_us() ^ ((uint32_t)getpid() << 12);
}

static void move(void)
{
    const uint32_t now_us = board_time_us();
    const float dt_s = (float)(now_us - moved_us) * 1e-6f;
    if (moved_us != 0) {
        left_counts += (v_m_s - 0.5f * WHEEL_BASE_M * yaw_rate_rad_s) * dt_s * COUNTS_PER_M;
        right_counts += (v_m_s + 0.5f * WHEEL_BASE_M * yaw_rate_rad_s) * dt_s * COUNTS_PER_M;
    }
    moved_us = now_us;
}

void board_imu(int16_t raw[7])
{
    memset(raw, 0, 7 * sizeof raw[0]);
    raw[2] = ONE_G;
    raw[6] = (int16_t)(yaw_rate_rad_s * GYRO_PER_RAD_S);
}

void board_encoders(uint16_t *left, uint16_t *right)
{
    move();
    *left = (uint16_t)(int32_t)left_counts;
    *right = (uint16_t)(int32_t)right_counts;
}

void board_drive(float wanted_v_m_s, float wanted_yaw_rate_rad_s)
{
    move();
    v_m_s = wanted_v_m_s;
    yaw_rate_rad_s = wanted_yaw_rate_rad_s;
}

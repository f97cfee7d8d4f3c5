/* A board on a pipe, which runs in the time of the process at the other end. At each wait it writes
 * u16 length, the written bytes, float v and float yaw rate. It then reads u32 time in
 * microseconds, u16 length and the bytes to read. Both are in the machine's own byte order. */
#include "board.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct {
    uint32_t now_us;
    uint8_t in[65536];
    uint16_t in_length;
    uint16_t in_taken;
    uint8_t out[65536];
    uint16_t out_length;
    float drive[2];
} board;

static bool get(void *data, size_t length)
{
    return length == 0 || fread(data, length, 1, stdin) == 1;
}

bool board_wait(void)
{
    if (board.in_taken != board.in_length) {
        return true;
    }
    fwrite(&board.out_length, sizeof board.out_length, 1, stdout);
    fwrite(board.out, 1, board.out_length, stdout);
    fwrite(board.drive, sizeof board.drive, 1, stdout);
    fflush(stdout);
    board.out_length = board.in_taken = 0;
    return get(&board.now_us, sizeof board.now_us)
        && get(&board.in_length, sizeof board.in_length) && get(board.in, board.in_length);
}

uint32_t board_time_us(void)
{
    return board.now_us;
}

size_t board_read(uint8_t *data, size_t room)
{
    const size_t left = (size_t)(board.in_length - board.in_taken);
    const size_t length = left < room ? left : room;
    memcpy(data, board.in + board.in_taken, length);
    board.in_taken = (uint16_t)(board.in_taken + length);
    return length;
}

void board_write(const uint8_t *data, size_t length)
{
    if (board.out_length + length > sizeof board.out - 1) {
        abort();
    }
    memcpy(board.out + board.out_length, data, length);
    board.out_length = (uint16_t)(board.out_length + length);
}

bool board_line_idle(void)
{
    return board.out_length == 0;
}

void board_uid(uint8_t uid[12])
{
    memcpy(uid, "lockstep-uid", 12);
}

uint32_t board_random(void)
{
    return 0x12345678u;
}

void board_imu(int16_t raw[7])
{
    const int16_t level[7] = {0, 0, 16384, 0, 0, 0, 0};
    memcpy(raw, level, sizeof level);
}

void board_encoders(uint16_t *left, uint16_t *right)
{
    *left = 100;
    *right = 65436;
}

void board_drive(float v_m_s, float yaw_rate_rad_s)
{
    board.drive[0] = v_m_s;
    board.drive[1] = yaw_rate_rad_s;
}

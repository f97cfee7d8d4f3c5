/* The functions of board.h for a library: each function calls the entry in its device's table. */
#include "board_api.h"

uint32_t board_now_us(board_t *board)
{
    return board->api->now_us(board->context);
}

uint32_t board_busy_us(board_t *board)
{
    return board->api->busy_us(board->context);
}

void board_watchdog_feed(board_t *board)
{
    board->api->watchdog_feed(board->context);
}

void board_reboot(board_t *board)
{
    board->api->reboot(board->context);
}

const board_identity_t *board_identity(board_t *board)
{
    return board->api->identity(board->context);
}

size_t board_uart_room(board_t *board)
{
    return board->api->uart_room(board->context);
}

void board_uart_write(board_t *board, const uint8_t *data, size_t length)
{
    board->api->uart_write(board->context, data, length);
}

uint32_t board_uart_wait_us(board_t *board)
{
    return board->api->uart_wait_us(board->context);
}

bool board_can_write(board_t *board, const sp_can_frame_t *frame)
{
    return board->api->can_write(board->context, frame);
}

void board_can_health(board_t *board, board_can_health_t *out)
{
    board->api->can_health(board->context, out);
}

void board_motors(board_t *board, int16_t left, int16_t right)
{
    board->api->motors(board->context, left, right);
}

void board_drivers(board_t *board, bool enabled)
{
    board->api->drivers(board->context, enabled);
}

void board_encoders(board_t *board, board_encoders_t *out)
{
    board->api->encoders(board->context, out);
}

void board_imu(board_t *board, board_imu_t *out)
{
    board->api->imu(board->context, out);
}

void board_ranges(board_t *board, board_ranges_t *out)
{
    board->api->ranges(board->context, out);
}

uint8_t board_contacts(board_t *board)
{
    return board->api->contacts(board->context);
}

void board_power(board_t *board, board_power_t *out)
{
    board->api->power(board->context, out);
}

const uint8_t *board_flash_page(board_t *board, unsigned page)
{
    return board->api->flash_page(board->context, page);
}

void board_flash_erase(board_t *board, unsigned page)
{
    board->api->flash_erase(board->context, page);
}

void board_flash_write(
    board_t *board, unsigned page, size_t offset, const uint8_t *data, size_t length)
{
    board->api->flash_write(board->context, page, offset, data, length);
}

bool board_flash_busy(board_t *board)
{
    return board->api->flash_busy(board->context);
}

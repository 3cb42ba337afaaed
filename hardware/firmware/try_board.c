/* A board on the host, for tests: told on stdin what happens to it, says on stdout what it did.
 *
 * Records on stdin, little-endian, without padding:
 *   'P' u32 starts, u8 after brown-out, u64 us, u8 encoders, u8 brakes, u8 force channels, u8 x 3 firmware,
 *       u32 x 4 counts per revolution, u16 x 4 largest current, u32 force unit, i32 full scale, 24 + 16 bytes of text
 *   'R' u64 us, u16 n, n bytes from the host
 *   'T' u64 us, i32 x 4 counts, i32 x 6 force, i16 x 4 current, u8 bits of good encoders, 16: supply cut
 *   'F' flush what was said so far; not answered itself
 * After each, on stdout:
 *   u8 state, u16 faults, u16 cause, u16 x 4 currents as the drivers were set, u8 homed, u32 x 8 counters,
 *   u16 n, n bytes sent
 * Currents above a limit, or other than zero outside Active, end the program (status 3), whatever the bytes said. */
#include <stdio.h>
#include <stdlib.h>

#include "phd_board.h"

static phd_board board;
static struct {
    uint16_t current_mA[PHD_JOINTS];
    uint8_t sent[1u << 16];
    size_t n;
} out;

static void stop(int status, const char *why)
{
    fprintf(stderr, "%s\n", why);
    exit(status);
}

static uint64_t get(size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++) {
        int byte = getchar();
        if (byte == EOF)
            stop(2, "a record is cut short");
        value |= (uint64_t)(unsigned)byte << (8 * i);
    }
    return value;
}

static void put(size_t bytes, uint64_t value)
{
    for (size_t i = 0; i < bytes; i++)
        putchar((int)(value >> (8 * i) & 255));
}

static void must_be_safe(void)
{
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        uint16_t most = board.state == PHD_ACTIVE && board.capability.brakes >> i & 1 ? board.limits.current_mA[i] : 0;
        if (out.current_mA[i] > most || most > board.capability.current_max_mA[i])
            stop(3, "more current than allowed");
    }
}

void phd_set_currents(const uint16_t current_mA[PHD_JOINTS])
{
    for (size_t i = 0; i < PHD_JOINTS; i++)
        out.current_mA[i] = current_mA[i];
    must_be_safe();
}

void phd_send(const uint8_t *frame, size_t n)
{
    must_be_safe(); /* before anything is said about it */
    if (n == 0 || n > PHD_MAX_FRAME || out.n + n > sizeof out.sent)
        stop(4, "a frame of no length, or too many");
    for (size_t i = 0; i < n; i++)
        out.sent[out.n++] = frame[i];
}

static void power_up(void)
{
    phd_capability made_of;
    uint32_t starts = (uint32_t)get(4);
    bool after_brown_out = get(1) != 0;
    uint64_t now_us = get(8);
    made_of.encoders = (uint8_t)get(1);
    made_of.brakes = (uint8_t)get(1);
    made_of.force_channels = (uint8_t)get(1);
    for (size_t i = 0; i < 3; i++)
        made_of.firmware[i] = (uint8_t)get(1);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        made_of.counts_per_rev[i] = (uint32_t)get(4);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        made_of.current_max_mA[i] = (uint16_t)get(2);
    made_of.force_unit = (uint32_t)get(4);
    made_of.force_full_scale = (int32_t)get(4);
    for (size_t i = 0; i < sizeof made_of.device; i++)
        made_of.device[i] = (char)get(1);
    for (size_t i = 0; i < sizeof made_of.serial; i++)
        made_of.serial[i] = (char)get(1);
    phd_board_power_up(&board, &made_of, starts, after_brown_out, now_us);
}

static void receive(void)
{
    static uint8_t bytes[1u << 16];
    uint64_t now_us = get(8);
    size_t n = (size_t)get(2);
    if (fread(bytes, 1, n, stdin) != n)
        stop(2, "a record is cut short");
    phd_board_receive(&board, bytes, n, now_us);
}

static void tick(void)
{
    phd_readings readings;
    uint64_t now_us = get(8);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        readings.counts[i] = (int32_t)get(4);
    for (size_t k = 0; k < PHD_MAX_FORCE; k++)
        readings.force[k] = (int32_t)get(4);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        readings.current_mA[i] = (int16_t)get(2);
    unsigned good = (unsigned)get(1);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        readings.encoder_good[i] = good >> i & 1;
    readings.supply_cut = good >> PHD_JOINTS & 1;
    phd_board_tick(&board, &readings, now_us);
}

static void say(void)
{
    const uint32_t counters[] = {
        board.decoder.good, board.decoder.bad_cobs, board.decoder.bad_crc, board.decoder.too_long,
        board.counts.not_understood, board.counts.old, board.counts.late, board.counts.refused,
    };
    must_be_safe();
    put(1, board.state);
    put(2, board.faults);
    put(2, board.cause);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        put(2, out.current_mA[i]);
    put(1, board.homed);
    for (size_t i = 0; i < sizeof counters / sizeof counters[0]; i++)
        put(4, counters[i]);
    put(2, out.n);
    fwrite(out.sent, 1, out.n, stdout);
    out.n = 0;
}

int main(void)
{
    for (int what = getchar(); what != EOF; what = getchar()) {
        if (what == 'P')
            power_up();
        else if (what == 'R')
            receive();
        else if (what == 'T')
            tick();
        else if (what == 'F')
            fflush(stdout);
        else
            stop(2, "no such record");
        if (what != 'F')
            say();
    }
    return 0;
}

/* The board on a processor whose int has 16 bits (ATmega2560, in simavr): when does it do what it does by itself?
 * Says on its serial port, one a line: ms until it has started; ms without a command until the watchdog acts, and the
 * current then and after two seconds (mA); ms of silence until it lets go of the host; the first ms at which a command
 * that waited so long is called late. 0: never, within the time that was looked at. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdio.h>

#include "phd_board.h"

static phd_board board;
static uint16_t driven_mA;
static uint64_t now_us;

void phd_set_currents(const uint16_t current_mA[PHD_JOINTS])
{
    driven_mA = current_mA[0];
}

void phd_send(const uint8_t *frame, size_t n) /* keeps it to itself */
{
    (void)frame;
    (void)n;
}

static void tell(const uint8_t *payload, size_t n)
{
    uint8_t frame[PHD_MAX_FRAME];
    phd_board_receive(&board, frame, phd_encode_frame(payload, n, frame), now_us);
}

static void command(uint8_t sequence, uint64_t sent_us)
{
    uint8_t payload[22] = {PHD_COMMAND, sequence};
    for (size_t i = 0; i < 8; i++)
        payload[5 + i] = (uint8_t)(sent_us >> (8 * i));
    payload[13] = 1;
    for (size_t i = 0; i < PHD_JOINTS; i++)
        payload[14 + 2 * i] = 200;
    tell(payload, sizeof payload);
}

/* Ticks until the board is in a state, of so many; 0: it never is. */
static uint16_t ticks_until(uint8_t state, uint16_t most)
{
    static const phd_readings readings = {.encoder_good = {true, true, true, true}};
    for (uint16_t tick = 1; tick <= most; tick++) {
        now_us += PHD_TICK_US;
        phd_board_tick(&board, &readings, now_us);
        if (board.state == state)
            return tick;
    }
    return 0;
}

static uint16_t start(void)
{
    static const phd_capability made_of = {
        .encoders = 5, .brakes = 15, .counts_per_rev = {96000, 0, 96000, 0}, .force_unit = 1000,
        .current_max_mA = {1000, 1000, 1000, 1000}, .force_full_scale = 66700,
    };
    phd_board_power_up(&board, &made_of, 1, false, now_us);
    return ticks_until(PHD_IDLE, 2000);
}

static void connect(void)
{
    static const uint8_t limits[25] = {PHD_SET_LIMITS, 0xF4, 1, 0xF4, 1, 0xF4, 1, 0xF4, 1}; /* 500 mA */
    tell(limits, sizeof limits);
}

static int put(char character, FILE *file)
{
    (void)file;
    loop_until_bit_is_set(UCSR0A, UDRE0);
    UDR0 = (uint8_t)character;
    return 0;
}

int main(void)
{
    static FILE port = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
    UCSR0B = 1 << TXEN0;
    stdout = &port;
    printf("start %u\n", start());
    connect();
    command(1, now_us);
    uint16_t tripped = ticks_until(PHD_FAULT, 2000);
    printf("watchdog %u %u\n", tripped, driven_mA);
    start();
    connect();
    printf("silence %u\n", ticks_until(PHD_IDLE, 2000));
    connect();
    uint8_t late = 1;
    for (; late < 100 && board.counts.late == 0; late++) {
        now_us += 1000;
        command(late, now_us - late * UINT32_C(1000)); /* the first one's way takes 1 ms */
    }
    printf("late %u\n", late - 1);
    cli();
    sleep_mode(); /* simavr ends */
    return 0;
}

#include "phd_board.h"

#include <string.h>

enum { SAME = PHD_SAME, REFUSED = PHD_IS_REFUSED, IGNORED = PHD_IGNORED, NONE = PHD_NOT_SEEN };
enum { BOOT = PHD_BOOT, IDLE = PHD_IDLE, READY = PHD_READY, ACTIVE = PHD_ACTIVE, FAULT = PHD_FAULT };

const uint8_t phd_states[PHD_EVENTS][PHD_STATES] = {
    /*                       Boot     Idle     Ready   Active   Fault */
    [PHD_ON_HELLO]       = {IGNORED, SAME,    IDLE,   IDLE,    SAME},
    [PHD_ON_LIMITS]      = {IGNORED, READY,   SAME,   REFUSED, SAME},
    [PHD_ON_COMMAND_ON]  = {IGNORED, REFUSED, ACTIVE, SAME,    SAME},
    [PHD_ON_COMMAND_OFF] = {IGNORED, REFUSED, SAME,   READY,   SAME},
    [PHD_ON_HOME]        = {IGNORED, SAME,    SAME,   REFUSED, SAME},
    [PHD_ON_RESET]       = {IGNORED, SAME,    SAME,   SAME,    IDLE},
    [PHD_ON_HEARTBEAT]   = {IGNORED, SAME,    SAME,   SAME,    SAME},
    [PHD_ON_STOP]        = {IGNORED, FAULT,   FAULT,  FAULT,   SAME},
    [PHD_ON_BYE]         = {IGNORED, SAME,    IDLE,   IDLE,    SAME},
    [PHD_ON_STARTED]     = {IDLE,    NONE,    NONE,   NONE,    NONE},
    [PHD_ON_STARTED_LOW] = {FAULT,   NONE,    NONE,   NONE,    NONE},
    [PHD_ON_SILENCE]     = {NONE,    NONE,    IDLE,   NONE,    SAME},
    [PHD_ON_WATCHDOG]    = {NONE,    NONE,    NONE,   FAULT,   NONE},
    [PHD_ON_CONDITION]   = {NONE,    NONE,    FAULT,  FAULT,   SAME},
    [PHD_ON_BROWN_OUT]   = {BOOT,    BOOT,    BOOT,   BOOT,    BOOT}, /* the supply does it: phd_board_power_up */
};

/* ------------------------------------------------------------------ messages, byte by byte: little-endian, no padding */

/* The next number of so many bytes; `at` moves behind it. */
static uint64_t get(const uint8_t **at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value |= (uint64_t)(*at)[i] << (8 * i);
    *at += bytes;
    return value;
}

/* A message is put together in board->out. */
static void put(phd_board *board, size_t bytes, uint64_t value)
{
    for (size_t i = 0; i < bytes; i++)
        board->out[board->out_n++] = (uint8_t)(value >> (8 * i));
}

static void begin(phd_board *board, uint8_t type)
{
    board->out_n = 0;
    put(board, 1, type);
}

static void put_bytes(phd_board *board, const void *from, size_t n)
{
    memcpy(board->out + board->out_n, from, n);
    board->out_n += n;
}

static void send(phd_board *board)
{
    uint8_t frame[PHD_MAX_FRAME];
    phd_send(frame, phd_encode_frame(board->out, board->out_n, frame));
}

static void send_hello(phd_board *board)
{
    const phd_capability *of = &board->capability;
    begin(board, PHD_HELLO);
    put(board, 1, PHD_VERSION);
    put(board, 1, board->state);
    put(board, 2, board->faults);
    put(board, 2, board->cause);
    put_bytes(board, of->firmware, sizeof of->firmware);
    put(board, 1, of->encoders);
    put(board, 1, of->brakes);
    put(board, 1, of->force_channels);
    put(board, 2, PHD_SAMPLE_HZ);
    put(board, 2, PHD_WATCHDOG_MS);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        put(board, 4, of->counts_per_rev[i]);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        put(board, 2, of->current_max_mA[i]);
    put(board, 4, of->force_unit);
    put(board, 4, (uint32_t)of->force_full_scale);
    put(board, 4, board->starts);
    put_bytes(board, of->device, sizeof of->device);
    put_bytes(board, of->serial, sizeof of->serial);
    send(board);
}

/* Counts and measured currents are sent as two's complement. */
static void send_sample(phd_board *board, uint64_t now_us)
{
    const phd_readings *read = &board->readings;
    begin(board, PHD_SAMPLE);
    put(board, 4, board->sequence);
    put(board, 4, board->freshness.last);
    put(board, 8, now_us);
    put(board, 1, board->state);
    put(board, 1, (uint8_t)(board->homed | board->flags | (read->supply_cut ? PHD_FLAG_CUT : 0)));
    put(board, 2, board->faults);
    put(board, 2, board->cause);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        if (board->capability.encoders >> i & 1)
            put(board, 4, (uint32_t)read->counts[i] + board->offset[i]);
    for (size_t k = 0; k < board->capability.force_channels; k++)
        put(board, 4, (uint32_t)read->force[k]);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        if (board->capability.brakes >> i & 1)
            put(board, 2, (uint16_t)read->current_mA[i]);
    send(board);
    board->flags &= (uint8_t)~PHD_FLAG_LATE;
}

static void refuse(phd_board *board, uint8_t type, uint8_t reason)
{
    begin(board, PHD_REFUSED);
    board->counts.refused++;
    put(board, 1, type);
    put(board, 1, reason);
    send(board);
}

static void report(phd_board *board, uint64_t now_us)
{
    begin(board, PHD_FAULT_REPORT);
    board->reported = board->faults;
    put(board, 2, board->faults);
    put(board, 2, board->cause);
    put(board, 1, board->detail);
    put(board, 8, now_us);
    send(board);
}

/* --------------------------------------------------------------------------------------------------- what it does */

static void drive(phd_board *board, const uint16_t current_mA[PHD_JOINTS])
{
    memcpy(board->current_mA, current_mA, sizeof board->current_mA);
    phd_set_currents(board->current_mA);
}

static void drive_zero(phd_board *board)
{
    static const uint16_t zero[PHD_JOINTS];
    drive(board, zero);
}

/* Go where the table says; false where the event is refused in this state. Currents flow in Active alone. */
static bool change(phd_board *board, enum phd_event event)
{
    uint8_t next = phd_states[event][board->state];
    if (next < PHD_STATES)
        board->state = next;
    if (board->state != PHD_ACTIVE)
        drive_zero(board);
    return next != PHD_IS_REFUSED;
}

static void disconnect(phd_board *board)
{
    drive_zero(board);
    memset(&board->limits, 0, sizeof board->limits);
    memset(&board->freshness, 0, sizeof board->freshness);
    board->connected = false;
    board->commanded_us = 0;
    board->flags = 0;
}

static void latch(phd_board *board, uint16_t fault, uint8_t detail)
{
    if (board->faults == 0) {
        board->cause = fault;
        board->detail = detail;
    }
    board->faults |= fault;
}

void phd_board_power_up(phd_board *board, const phd_capability *capability, uint32_t starts, bool after_brown_out,
                        uint64_t now_us)
{
    memset(board, 0, sizeof *board); /* PHD_BOOT is 0 */
    board->capability = *capability;
    board->starts = starts;
    board->after_brown_out = after_brown_out;
    board->started_us = board->heard_us = now_us;
    board->detail = PHD_NO_DETAIL;
    disconnect(board);
}

/* --------------------------------------------------------------------------------------------- what it is told */

static void command(phd_board *board, const uint8_t *at, uint64_t now_us)
{
    uint32_t sequence = (uint32_t)get(&at, 4);
    uint64_t host_us = get(&at, 8);
    uint8_t mode = (uint8_t)get(&at, 1);
    if (mode > 1) {
        refuse(board, PHD_COMMAND, PHD_BAD_VALUE);
        return;
    }
    enum phd_age age = phd_freshness_judge(&board->freshness, sequence, host_us, now_us);
    if (age == PHD_OLD) {
        board->counts.old++;
        return;
    }
    if (age == PHD_LATE && mode == 1) { /* off is obeyed however late */
        board->counts.late++;
        board->flags |= PHD_FLAG_LATE;
        return;
    }
    if (!change(board, mode == 1 ? PHD_ON_COMMAND_ON : PHD_ON_COMMAND_OFF)) {
        refuse(board, PHD_COMMAND, PHD_WRONG_STATE);
        return;
    }
    board->freshness.last = sequence;
    board->freshness.taken = true;
    board->commanded_us = now_us;
    if (board->state != PHD_ACTIVE)
        return;
    uint16_t current_mA[PHD_JOINTS];
    board->flags &= (uint8_t)~PHD_FLAG_CLAMPED;
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        uint16_t most = board->capability.brakes >> i & 1 ? board->limits.current_mA[i] : 0;
        current_mA[i] = (uint16_t)get(&at, 2);
        if (current_mA[i] > most) {
            current_mA[i] = most;
            board->flags |= PHD_FLAG_CLAMPED;
        }
    }
    drive(board, current_mA);
}

static void set_limits(phd_board *board, const uint8_t *at)
{
    phd_limits *limits = &board->limits;
    begin(board, PHD_LIMITS);
    board->connected = true;
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        uint16_t asked = (uint16_t)get(&at, 2), most = board->capability.current_max_mA[i];
        limits->current_mA[i] = asked < most ? asked : most;
        put(board, 2, limits->current_mA[i]);
    }
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        limits->speed_counts_s[i] = (uint32_t)get(&at, 4);
        put(board, 4, limits->speed_counts_s[i]);
    }
    send(board);
}

static void home(phd_board *board, const uint8_t *at)
{
    uint8_t joints = (uint8_t)get(&at, 1);
    begin(board, PHD_HOMED);
    put(board, 1, joints);
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        uint32_t counts = (uint32_t)get(&at, 4);
        put(board, 4, counts);
        if (joints >> i & 1)
            board->offset[i] = counts - (uint32_t)board->readings.counts[i];
    }
    board->homed |= joints;
    send(board);
}

/* Obey a message other than Command, which the table allows in this state, and answer. */
static void obey(phd_board *board, uint8_t type, const uint8_t *at, uint64_t now_us)
{
    switch (type) {
    case PHD_ASK_HELLO:
        disconnect(board);
        send_hello(board);
        if (*at != PHD_VERSION)
            refuse(board, type, PHD_OTHER_VERSION);
        break;
    case PHD_SET_LIMITS:
        set_limits(board, at);
        break;
    case PHD_HOME:
        home(board, at);
        break;
    case PHD_RESET_FAULT:
        if (board->faults != 0)
            disconnect(board);
        board->faults = board->cause = 0;
        board->detail = PHD_NO_DETAIL;
        report(board, now_us);
        break;
    case PHD_HEARTBEAT:
        begin(board, PHD_HEARTBEAT_REPLY);
        put(board, 4, get(&at, 4));
        put(board, 8, now_us);
        send(board);
        break;
    case PHD_STOP:
        latch(board, PHD_FAULT_HOST_REQUEST, PHD_NO_DETAIL);
        report(board, now_us);
        break;
    default: /* Bye */
        disconnect(board);
        break;
    }
}

/* Take in a message: its type and, at `at`, its fields. */
static void take(phd_board *board, uint8_t type, const uint8_t *at, uint64_t now_us)
{
    static const uint8_t event_of[] = { /* by type, from AskHello (1) to Bye (8); Command has two */
        0, PHD_ON_HELLO, PHD_ON_LIMITS, 0, PHD_ON_HOME, PHD_ON_RESET, PHD_ON_HEARTBEAT, PHD_ON_STOP, PHD_ON_BYE,
    };
    if (type == PHD_COMMAND)
        command(board, at, now_us);
    else if (type == PHD_HOME && (*at == 0 || (*at & ~board->capability.encoders)))
        refuse(board, type, PHD_BAD_VALUE);
    else if (type == PHD_RESET_FAULT && board->faults != 0 && board->standing)
        refuse(board, type, PHD_FAULT_STANDS);
    else if (!change(board, (enum phd_event)event_of[type]))
        refuse(board, type, PHD_WRONG_STATE);
    else
        obey(board, type, at, now_us);
}

/* A tick's time may be a little before that of bytes that came while it waited: that is no time, not 2^64 us. */
static uint64_t since(uint64_t then_us, uint64_t now_us)
{
    return now_us > then_us ? now_us - then_us : 0;
}

/* Trips while there is still a tick left, so that currents are zero at 50 ms at the latest. */
static void watchdog(phd_board *board, uint64_t now_us)
{
    if (board->state == PHD_ACTIVE && since(board->commanded_us, now_us) > PHD_WATCHDOG_US - PHD_TICK_US) {
        change(board, PHD_ON_WATCHDOG);
        latch(board, PHD_FAULT_WATCHDOG, PHD_NO_DETAIL);
    }
}

void phd_board_receive(phd_board *board, const uint8_t *bytes, size_t n, uint64_t now_us)
{
    static const uint8_t lengths[] = {0, 2, 25, 22, 18, 1, 5, 1, 1}; /* of each type, from AskHello (1) to Bye (8) */
    const uint8_t *payload = board->decoder.bytes;
    for (size_t i = 0; i < n; i++) {
        size_t length = phd_decode(&board->decoder, bytes[i]);
        if (length == 0)
            continue;
        if (payload[0] < PHD_ASK_HELLO || payload[0] > PHD_BYE || length != lengths[payload[0]]) {
            board->counts.not_understood++;
            continue;
        }
        watchdog(board, now_us);
        board->heard_us = now_us;
        if (board->state != PHD_BOOT)
            take(board, payload[0], payload + 1, now_us);
    }
}

/* ----------------------------------------------------------------------------------------------- each millisecond */

static void check(phd_board *board)
{
    phd_condition found[PHD_MAX_CONDITIONS];
    size_t n = phd_watch_look(&board->watch, &board->capability, &board->limits, &board->readings, found);
    board->standing = n > 0 || board->readings.supply_cut;
    for (size_t k = 0; k < n; k++) {
        if (board->state == PHD_IDLE || (board->faults & found[k].fault))
            continue;
        change(board, PHD_ON_CONDITION);
        latch(board, found[k].fault, found[k].detail);
    }
}

void phd_board_tick(phd_board *board, const phd_readings *readings, uint64_t now_us)
{
    board->readings = *readings;
    if (board->state == PHD_BOOT) {
        if (since(board->started_us, now_us) >= PHD_START_US) {
            board->heard_us = now_us;
            change(board, board->after_brown_out ? PHD_ON_STARTED_LOW : PHD_ON_STARTED);
            if (board->after_brown_out)
                latch(board, PHD_FAULT_BROWN_OUT, PHD_NO_DETAIL);
        }
        return;
    }
    board->sequence++;
    if (readings->supply_cut) { /* so that no current comes back with the supply */
        change(board, PHD_ON_STOP);
        latch(board, PHD_FAULT_HOST_REQUEST, PHD_NO_DETAIL);
    }
    watchdog(board, now_us);
    if (board->connected && board->state != PHD_ACTIVE && since(board->heard_us, now_us) >= PHD_SILENCE_US) {
        change(board, PHD_ON_SILENCE);
        disconnect(board);
    }
    check(board);
    if (board->connected) {
        if (board->faults != board->reported)
            report(board, now_us);
        send_sample(board, now_us);
    }
}

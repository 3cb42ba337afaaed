#include "phd_board.h"

#define SAME PHD_SAME
#define REFUSED PHD_IS_REFUSED
#define IGNORED PHD_IGNORED
#define NONE PHD_NOT_SEEN
#define BOOT PHD_BOOT
#define IDLE PHD_IDLE
#define READY PHD_READY
#define ACTIVE PHD_ACTIVE
#define FAULT PHD_FAULT

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

/* --------------------------------------------------------------------------------------------------- what it does */

static void drive(phd_board *board, const uint16_t current_mA[PHD_JOINTS])
{
    for (size_t i = 0; i < PHD_JOINTS; i++)
        board->current_mA[i] = current_mA[i];
    board->hardware.set_currents(board->hardware.context, board->current_mA);
}

static void drive_zero(phd_board *board)
{
    static const uint16_t zero[PHD_JOINTS];
    drive(board, zero);
}

static void send(phd_board *board, const uint8_t *payload, size_t n)
{
    uint8_t frame[PHD_MAX_FRAME];
    board->hardware.send(board->hardware.context, frame, phd_encode_frame(payload, n, frame));
}

static void refuse(phd_board *board, uint8_t type, uint8_t reason)
{
    uint8_t payload[PHD_MAX_PAYLOAD];
    board->counts.refused++;
    send(board, payload, phd_pack_refused(payload, type, reason));
}

static void report(phd_board *board, uint64_t now_us)
{
    uint8_t payload[PHD_MAX_PAYLOAD];
    board->reported = board->faults;
    send(board, payload, phd_pack_fault_report(payload, board->faults, board->cause, board->detail, now_us));
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
    static const phd_limits no_limits;
    static const phd_freshness nothing_came;
    drive_zero(board);
    board->limits = no_limits;
    board->connected = false;
    board->freshness = nothing_came;
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

void phd_board_power_up(phd_board *board, const phd_capability *capability, const phd_hardware *hardware,
                        uint32_t starts, bool after_brown_out, uint64_t now_us)
{
    static const phd_board nothing;
    *board = nothing; /* PHD_BOOT is 0 */
    board->capability = *capability;
    board->hardware = *hardware;
    board->starts = starts;
    board->after_brown_out = after_brown_out;
    board->started_us = board->heard_us = now_us;
    board->detail = PHD_NO_DETAIL;
    phd_decoder_init(&board->decoder);
    phd_watch_init(&board->watch);
    disconnect(board);
}

/* --------------------------------------------------------------------------------------------- what it is told */

static void command(phd_board *board, const phd_request *request, uint64_t now_us)
{
    if (request->mode > 1) {
        refuse(board, request->type, PHD_BAD_VALUE);
        return;
    }
    enum phd_age age = phd_freshness_judge(&board->freshness, request->sequence, request->host_us, now_us);
    if (age == PHD_OLD) {
        board->counts.old++;
        return;
    }
    if (age == PHD_LATE && request->mode == 1) { /* off is obeyed however late */
        board->counts.late++;
        board->flags |= PHD_FLAG_LATE;
        return;
    }
    if (!change(board, request->mode == 1 ? PHD_ON_COMMAND_ON : PHD_ON_COMMAND_OFF)) {
        refuse(board, request->type, PHD_WRONG_STATE);
        return;
    }
    board->freshness.last = request->sequence;
    board->freshness.taken = true;
    board->commanded_us = now_us;
    if (board->state != PHD_ACTIVE)
        return;
    uint16_t current_mA[PHD_JOINTS];
    bool clamped = false;
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        uint16_t most = board->capability.brakes >> i & 1 ? board->limits.current_mA[i] : 0;
        current_mA[i] = request->current_mA[i] < most ? request->current_mA[i] : most;
        clamped = clamped || current_mA[i] != request->current_mA[i];
    }
    drive(board, current_mA);
    board->flags = (uint8_t)((board->flags & ~PHD_FLAG_CLAMPED) | (clamped ? PHD_FLAG_CLAMPED : 0));
}

/* Obey a message other than Command, which the table allows in this state, and answer. */
static void obey(phd_board *board, const phd_request *request, uint64_t now_us)
{
    uint8_t payload[PHD_MAX_PAYLOAD];
    switch (request->type) {
    case PHD_ASK_HELLO:
        disconnect(board);
        send(board, payload, phd_pack_hello(payload, &board->capability, board->state, board->faults, board->cause,
                                            board->starts));
        if (request->version != PHD_VERSION)
            refuse(board, request->type, PHD_OTHER_VERSION);
        break;
    case PHD_SET_LIMITS:
        board->limits = request->limits;
        for (size_t i = 0; i < PHD_JOINTS; i++)
            if (board->limits.current_mA[i] > board->capability.current_max_mA[i])
                board->limits.current_mA[i] = board->capability.current_max_mA[i];
        board->connected = true;
        send(board, payload, phd_pack_limits(payload, &board->limits));
        break;
    case PHD_HOME:
        for (size_t i = 0; i < PHD_JOINTS; i++)
            if (request->joints >> i & 1)
                board->offset[i] = request->counts[i] - (uint32_t)board->readings.counts[i];
        board->homed |= request->joints;
        send(board, payload, phd_pack_homed(payload, request->joints, request->counts));
        break;
    case PHD_RESET_FAULT:
        if (board->faults != 0)
            disconnect(board);
        board->faults = board->cause = 0;
        board->detail = PHD_NO_DETAIL;
        report(board, now_us);
        break;
    case PHD_HEARTBEAT:
        send(board, payload, phd_pack_heartbeat_reply(payload, request->token, now_us));
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

static void take(phd_board *board, const phd_request *request, uint64_t now_us)
{
    static const uint8_t event_of[] = { /* by type, from AskHello (1) to Bye (8); Command has two */
        0, PHD_ON_HELLO, PHD_ON_LIMITS, 0, PHD_ON_HOME, PHD_ON_RESET, PHD_ON_HEARTBEAT, PHD_ON_STOP, PHD_ON_BYE,
    };
    if (request->type == PHD_COMMAND)
        command(board, request, now_us);
    else if (request->type == PHD_HOME && (request->joints == 0 || (request->joints & ~board->capability.encoders)))
        refuse(board, request->type, PHD_BAD_VALUE);
    else if (request->type == PHD_RESET_FAULT && board->faults != 0 && board->standing)
        refuse(board, request->type, PHD_FAULT_STANDS);
    else if (!change(board, (enum phd_event)event_of[request->type]))
        refuse(board, request->type, PHD_WRONG_STATE);
    else
        obey(board, request, now_us);
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
    for (size_t i = 0; i < n; i++) {
        phd_request request;
        size_t payload = phd_decode(&board->decoder, bytes[i]);
        if (payload == 0)
            continue;
        if (!phd_unpack(board->decoder.bytes, payload, &request)) {
            board->counts.not_understood++;
            continue;
        }
        watchdog(board, now_us);
        board->heard_us = now_us;
        if (board->state != PHD_BOOT)
            take(board, &request, now_us);
    }
}

void phd_board_stop(phd_board *board)
{
    change(board, PHD_ON_STOP);
    if (board->state != PHD_BOOT)
        latch(board, PHD_FAULT_HOST_REQUEST, PHD_NO_DETAIL);
}

/* ----------------------------------------------------------------------------------------------- each millisecond */

static void check(phd_board *board)
{
    phd_condition found[PHD_MAX_CONDITIONS];
    size_t n = phd_watch_look(&board->watch, &board->capability, &board->limits, &board->readings, found);
    board->standing = n > 0;
    for (size_t k = 0; k < n; k++) {
        if (board->state == PHD_IDLE || (board->faults & found[k].fault))
            continue;
        change(board, PHD_ON_CONDITION);
        latch(board, found[k].fault, found[k].detail);
    }
}

static void send_sample(phd_board *board, uint64_t now_us)
{
    uint8_t payload[PHD_MAX_PAYLOAD];
    phd_sample sample = {
        .sequence = board->sequence, .echo = board->freshness.last, .board_us = now_us, .state = board->state,
        .flags = board->homed | board->flags, .faults = board->faults, .cause = board->cause,
    };
    for (size_t i = 0; i < PHD_JOINTS; i++) {
        sample.counts[i] = (uint32_t)board->readings.counts[i] + board->offset[i];
        sample.current_mA[i] = (uint16_t)board->readings.current_mA[i];
    }
    for (size_t k = 0; k < PHD_MAX_FORCE; k++)
        sample.force[k] = (uint32_t)board->readings.force[k];
    send(board, payload, phd_pack_sample(payload, &board->capability, &sample));
    board->flags &= (uint8_t)~PHD_FLAG_LATE;
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

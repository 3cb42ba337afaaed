/* A board for the emulator: in place of sensors, amplifiers and clock a plant behind USART3, which says when and what.
 *
 * The host's bytes come over USART2 as on a real board. Frames as on the host's wire; what they hold is as in
 * try_board.c, where told P, R and T and what is answered are described; but
 *   R has only the number of bytes, which come over the host's port, not the bytes,
 *   P to a board that runs resets the processor,
 *   the firmware says 'U' when it has come out of a reset and waits for its P,
 *   an answer ends with u16 bytes sent to the host, u32 deepest stack (bytes), u32 clocks that it took. */
#include "board.h"
#include "registers.h"
#include "uart.h"

enum { BAUD = 921600, CLOCKS = 0xFFFFFF, PAINT = 0x5AFE5AFE };

extern uint32_t stack_bottom, stack_top;

static uart host, plant;
static phd_decoder decoder;
static phd_capability made_of;
static phd_readings newest;
static uint16_t driven[PHD_JOINTS];
static uint64_t now_us;
static size_t awaited, sent; /* bytes from the host in this step, and to it */
static bool stepping;        /* the plant waits for an answer */
static uint32_t began;       /* the processor's clock at its begin, which counts down */

void on_usart2(void)
{
    uart_serve(&host);
}

void on_usart3(void)
{
    uart_serve(&plant);
}

static uint64_t get(const uint8_t **at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value |= (uint64_t) * (*at)++ << (8 * i);
    return value;
}

static void put(uint8_t **at, size_t bytes, uint64_t value)
{
    for (size_t i = 0; i < bytes; i++)
        *(*at)++ = (uint8_t)(value >> (8 * i));
}

static void say(const uint8_t *payload, size_t n)
{
    uint8_t frame[PHD_MAX_FRAME];
    uart_send(&plant, frame, phd_encode_frame(payload, n, frame));
}

/* Send what waits: QEMU raises no interrupt when a transmitter is empty. */
static void pump(uart *port)
{
    while (port->out.head != port->out.tail)
        uart_serve(port);
}

/* Sleep until something comes: an emulated processor that is busy keeps bytes from coming. */
static void rest(void)
{
    pump(&plant);
    pump(&host);
    uint32_t before = masked();
    if (plant.in.head == plant.in.tail && (awaited == 0 || host.in.head == host.in.tail))
        __asm volatile("wfi"); /* an interrupt ends it, also while it is masked */
    unmasked(before);
}

/* The next frame of the plant; NULL: none yet. */
static const uint8_t *hear(void)
{
    uint8_t byte;
    rest();
    while (ring_take(&plant.in, &byte))
        if (phd_decode(&decoder, byte) > 0)
            return decoder.bytes;
    return 0;
}

/* What of the stack is not in use yet: nearly all, for it is called first of all in main. */
static void paint_stack(void)
{
    uint32_t *here;
    __asm volatile("mov %0, sp" : "=r"(here));
    for (uint32_t *to = &stack_bottom; to < here - 16; to++)
        *to = PAINT;
}

static uint32_t stack_deepest(void) /* bytes that were ever in use since reset */
{
    const uint32_t *at = &stack_bottom;
    while (at < &stack_top && *at == PAINT)
        at++;
    return (uint32_t)(&stack_top - at) * 4;
}

static void answer(void)
{
    uint8_t payload[PHD_MAX_PAYLOAD], *at = payload;
    const uint32_t counters[] = {
        board.decoder.good, board.decoder.bad_cobs, board.decoder.bad_crc, board.decoder.too_long,
        board.counts.not_understood, board.counts.old, board.counts.late, board.counts.refused,
    };
    uint32_t clocks = (began - SYST_CVR) & CLOCKS;
    put(&at, 1, board.state);
    put(&at, 2, board.faults);
    put(&at, 2, board.cause);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        put(&at, 2, driven[i]);
    put(&at, 1, board.homed);
    for (size_t i = 0; i < sizeof counters / sizeof counters[0]; i++)
        put(&at, 4, counters[i]);
    put(&at, 2, sent);
    put(&at, 4, stack_deepest());
    put(&at, 4, clocks);
    say(payload, (size_t)(at - payload));
    sent = 0;
    stepping = false;
}

static void begin_step(uint64_t us)
{
    now_us = us;
    stepping = true;
    began = SYST_CVR;
}

void clock_begin(void)
{
    paint_stack();
    RCC_APB1ENR |= BIT(17) | BIT(18); /* USART2, USART3 */
    SYST_RVR = CLOCKS;
    SYST_CSR = 5; /* counts the processor's clock, and interrupts nobody */
    uart_begin(&plant, USART3, APB1_HZ, BAUD);
    uart_begin(&host, USART2, APB1_HZ, BAUD);
    NVIC_ENABLE(IRQ_USART2);
    NVIC_ENABLE(IRQ_USART3);
}

uint64_t clock_us(void)
{
    return now_us;
}

bool tick_is_due(void)
{
    if (stepping && awaited == 0)
        answer();
    if (stepping)
        rest();
    const uint8_t *at = stepping ? 0 : hear();
    if (at == 0)
        return false;
    uint8_t what = *at++;
    if (what == 'P') {
        SCB_AIRCR = UINT32_C(0x05FA0004); /* system reset */
        for (;;) {
        }
    }
    begin_step(get(&at, 8));
    if (what == 'R') {
        awaited = (size_t)get(&at, 2);
        return false;
    }
    for (size_t i = 0; i < PHD_JOINTS; i++)
        newest.counts[i] = (int32_t)get(&at, 4);
    for (size_t k = 0; k < PHD_MAX_FORCE; k++)
        newest.force[k] = (int32_t)get(&at, 4);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        newest.current_mA[i] = (int16_t)get(&at, 2);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        newest.encoder_good[i] = *at >> i & 1;
    newest.supply_cut = *at >> PHD_JOINTS & 1;
    return true;
}

supply_story supply_begin(void)
{
    static const uint8_t up = 'U';
    supply_story story;
    const uint8_t *at;
    say(&up, 1);
    while ((at = hear()) == 0) {
    }
    at++;
    story.starts = (uint32_t)get(&at, 4);
    story.after_brown_out = get(&at, 1) != 0;
    begin_step(get(&at, 8));
    made_of.encoders = (uint8_t)get(&at, 1);
    made_of.brakes = (uint8_t)get(&at, 1);
    made_of.force_channels = (uint8_t)get(&at, 1);
    for (size_t i = 0; i < 3; i++)
        made_of.firmware[i] = (uint8_t)get(&at, 1);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        made_of.counts_per_rev[i] = (uint32_t)get(&at, 4);
    for (size_t i = 0; i < PHD_JOINTS; i++)
        made_of.current_max_mA[i] = (uint16_t)get(&at, 2);
    made_of.force_unit = (uint32_t)get(&at, 4);
    made_of.force_full_scale = (int32_t)get(&at, 4);
    for (size_t i = 0; i < sizeof made_of.device; i++)
        made_of.device[i] = (char)get(&at, 1);
    for (size_t i = 0; i < sizeof made_of.serial; i++)
        made_of.serial[i] = (char)get(&at, 1);
    return story;
}

const phd_capability *capability(void)
{
    return &made_of;
}

bool supply_is_cut(void)
{
    return newest.supply_cut;
}

void encoders_read(phd_readings *readings)
{
    *readings = newest; /* what the others read stands in it as well */
}

void phd_set_currents(const uint16_t current_mA[PHD_JOINTS])
{
    for (size_t i = 0; i < PHD_JOINTS; i++)
        driven[i] = current_mA[i];
}

void brakes_off(void)
{
    static const uint16_t zero[PHD_JOINTS];
    phd_set_currents(zero);
}

void host_poll(void)
{
    pump(&host);
}

size_t host_read(uint8_t *bytes, size_t most)
{
    size_t n = awaited == 0 ? 0 : ring_take_most(&host.in, bytes, awaited < most ? awaited : most);
    awaited -= n;
    return n;
}

void phd_send(const uint8_t *frame, size_t n)
{
    uart_send(&host, frame, n);
    sent += n;
}

/* What the emulator has not, or the plant does. */
void encoders_begin(void) {}
void force_begin(void) {}
void force_read(phd_readings *readings) { (void)readings; }
void brakes_begin(void) {}
void brakes_read(phd_readings *readings) { (void)readings; }
void brakes_enable(bool may_flow) { (void)may_flow; }
void host_begin(void) {}
void watchdog_begin(void) {}
void watchdog_feed(void) {}
void lights_begin(void) {}
void lights_show(uint8_t state, bool cut) { (void)state; (void)cut; }

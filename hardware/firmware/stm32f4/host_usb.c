/* The host's port by USB: a serial port (CDC-ACM) of full speed, looked after from the main loop without interrupts.
 * Endpoint 0 is control; 1 is data, each way; 2, which CDC asks for, never has anything to say. */
#include "board.h"
#include "otg.h"
#include "ring.h"

enum { DATA = 1, NOTES = 2, PACKET = 64, FIFO_WORDS = 128 };
enum { GET_STATUS, CLEAR_FEATURE, SET_ADDRESS = 5, GET_DESCRIPTOR, GET_CONFIGURATION = 8, SET_CONFIGURATION,
       GET_INTERFACE, SET_INTERFACE };                                     /* requests of USB, */
enum { SET_LINE_CODING = 0x20, GET_LINE_CODING, SET_LINE_STATE }; /* and of CDC */

static const uint8_t device[18] = {
    18, 1, 0x00, 2, 2, 0, 0, PACKET, 0x09, 0x12, 0x01, 0x00, 0x00, 1, 1, 2, 3, 1, /* 1209:0001 is for tests */
};
static const uint8_t configuration[67] = {
    9, 2, 67, 0, 2, 1, 0, 0xC0, 0,
    9, 4, 0, 0, 1, 2, 2, 0, 0,        /* interface 0: control of a serial port */
    5, 0x24, 0, 0x10, 1, 5, 0x24, 1, 0, 1, 4, 0x24, 2, 2, 5, 0x24, 6, 0, 1,
    7, 5, 0x80 | NOTES, 3, 8, 0, 255,
    9, 4, 1, 0, 2, 10, 0, 0, 0,       /* interface 1: its data */
    7, 5, DATA, 2, PACKET, 0, 0,
    7, 5, 0x80 | DATA, 2, PACKET, 0, 0,
};

static ring in, out;
static uint8_t setup[8], coding[7] = {0x00, 0x10, 0x0E, 0, 0, 0, 8}; /* 921,600 baud, which means nothing here */
static uint8_t configured;

static void change(uint32_t at, uint32_t clear, uint32_t set)
{
    otg_set(at, (otg_get(at) & ~clear) | set);
}

/* ------------------------------------------------------------------------------------------------------ endpoints */

static void write_packets(unsigned endpoint, const uint8_t *bytes, size_t n)
{
    otg_set(DIEPTSIZ(endpoint), (uint32_t)((n + PACKET - 1) / PACKET + (n == 0)) * ONE_PACKET | (uint32_t)n);
    change(DIEPCTL(endpoint), 0, EP_ENABLE | EP_CLEAR_NAK);
    for (size_t i = 0; i < n; i += 4) {
        uint32_t word = 0;
        for (size_t k = 0; k < 4 && i + k < n; k++)
            word |= (uint32_t)bytes[i + k] << (8 * k);
        otg_set(FIFO(endpoint), word);
    }
}

/* Take a packet out of the FIFO; `most` bytes of it are kept. */
static void read_packet(size_t n, uint8_t *bytes, size_t most)
{
    uint32_t word = 0;
    for (size_t i = 0; i < n; i++) {
        if (i % 4 == 0)
            word = otg_get(FIFO(0));
        uint8_t byte = (uint8_t)(word >> (8 * (i % 4)));
        if (bytes == 0)
            ring_put(&in, byte);
        else if (i < most)
            bytes[i] = byte;
    }
}

static void listen(unsigned endpoint)
{
    otg_set(DOEPTSIZ(endpoint), (endpoint == 0 ? THREE_SETUPS : 0) | ONE_PACKET | PACKET);
    change(DOEPCTL(endpoint), 0, EP_ENABLE | EP_CLEAR_NAK);
}

static void core_reset(uint32_t what)
{
    otg_set(GRSTCTL, what);
    for (unsigned n = 0; otg_get(GRSTCTL) & (BIT(5) | BIT(4) | BIT(0)) && n < 100000; n++) {
    }
}

/* -------------------------------------------------------------------------------------------------- what is asked */

static void configure(void)
{
    change(DIEPCTL(DATA), 0, PACKET | EP_ON | 2u << 18 | DATA << 22 | EP_DATA0 | EP_SET_NAK);
    change(DIEPCTL(NOTES), 0, 8 | EP_ON | 3u << 18 | NOTES << 22 | EP_DATA0 | EP_SET_NAK);
    change(DOEPCTL(DATA), 0, PACKET | EP_ON | 2u << 18 | EP_DATA0);
    listen(DATA);
}

/* A text as a descriptor: maker, product, serial number; 0: the language, English. */
static size_t text_descriptor(uint8_t which, uint8_t text[64])
{
    const char *const texts[] = {"\x09", "PHD", "PHD board", capability()->serial};
    size_t n = 2;
    for (size_t i = 0; i < sizeof capability()->serial && texts[which][i]; i++) {
        text[n++] = (uint8_t)texts[which][i];
        text[n++] = which == 0 ? 4 : 0;
    }
    text[0] = (uint8_t)n;
    text[1] = 3;
    return n;
}

static void reply(const uint8_t *bytes, size_t n)
{
    size_t asked = setup[6] | (size_t)setup[7] << 8;
    write_packets(0, bytes, n < asked ? n : asked);
}

static void refuse(void)
{
    change(DIEPCTL(0), 0, EP_STALL);
    change(DOEPCTL(0), 0, EP_STALL);
}

static void answer(void)
{
    static const uint8_t nothing[2];
    uint8_t text[64];
    switch (setup[1]) {
    case GET_DESCRIPTOR:
        if (setup[3] == 1)
            reply(device, sizeof device);
        else if (setup[3] == 2)
            reply(configuration, sizeof configuration);
        else if (setup[3] == 3 && setup[2] < 4)
            reply(text, text_descriptor(setup[2], text));
        else
            refuse();
        return;
    case GET_STATUS:
    case GET_INTERFACE: /* of one byte, which is all that is asked for */
        reply(nothing, 2);
        return;
    case GET_CONFIGURATION:
        reply(&configured, 1);
        return;
    case GET_LINE_CODING:
        reply(coding, sizeof coding);
        return;
    case SET_LINE_CODING:
        return; /* its bytes come first */
    case SET_ADDRESS:
        change(DCFG, 0x7Fu << 4, (uint32_t)setup[2] << 4);
        break;
    case SET_CONFIGURATION:
        configured = setup[2];
        if (configured)
            configure();
        break;
    case SET_LINE_STATE:
        if (!(setup[2] & 1)) /* the host has closed the port: what waits is old */
            out.tail = out.head;
        break;
    case CLEAR_FEATURE:
        if (setup[0] == 2 && (setup[4] & 3) != 0) /* of an endpoint: its packets are counted anew */
            change(setup[4] & 0x80 ? DIEPCTL(setup[4] & 3u) : DOEPCTL(setup[4] & 3u), 0, EP_DATA0);
        break;
    case SET_INTERFACE:
        break;
    default:
        refuse();
        return;
    }
    write_packets(0, nothing, 0);
}

/* --------------------------------------------------------------------------------------------------- what happens */

static void receive(void)
{
    uint32_t status = otg_get(GRXSTSP);
    unsigned endpoint = status & 15, n = status >> 4 & 0x7FF;
    switch (status >> 17 & 15) {
    case GOT_SETUP:
        read_packet(n, setup, sizeof setup);
        break;
    case SETUP_DONE:
        otg_set(DOEPINT(0), BIT(3));
        listen(0);
        if (setup[0] & 0x60 ? setup[1] >= SET_LINE_CODING : setup[1] < SET_LINE_CODING)
            answer();
        else
            refuse();
        break;
    case GOT_DATA:
        if (endpoint == DATA)
            read_packet(n, 0, 0);
        else {
            read_packet(n, coding, sizeof coding);
            if (n > 0)
                write_packets(0, coding, 0);
        }
        break;
    case OUT_DONE:
        if (endpoint == 0)
            listen(0);
        break;
    }
}

static void start_anew(void)
{
    configured = 0;
    out.tail = out.head;
    change(DCFG, 0x7Fu << 4, 0);
    otg_set(GRXFSIZ, FIFO_WORDS); /* words, of 320; then of each endpoint to the host size and where it begins */
    otg_set(DIEPTXF0, 32u << 16 | FIFO_WORDS);
    otg_set(DIEPTXF1, FIFO_WORDS << 16 | (FIFO_WORDS + 32));
    otg_set(DIEPTXF2, 16u << 16 | (2 * FIFO_WORDS + 32));
    core_reset(16u << 6 | BIT(5) | BIT(4)); /* all FIFOs are emptied */
    listen(0);
}

void host_begin(void)
{
    otg_clock();
    otg_set(GUSBCFG, BIT(6)); /* its own transceiver */
    core_reset(BIT(0));
    otg_set(GUSBCFG, BIT(6) | BIT(30) | 6u << 10); /* a device, whatever a pin says */
    for (volatile uint32_t n = 0; n < 1000000; n++) { /* 25 ms and more until that holds */
    }
#ifdef STM32F405
    otg_set(GCCFG, BIT(16) | BIT(21)); /* transceiver on; nobody looks at the bus's voltage */
#else
    otg_set(GCCFG, BIT(16));
    change(GOTGCTL, 0, BIT(6) | BIT(7)); /* the same: it is taken for there */
#endif
    otg_set(PCGCCTL, 0);
    change(DCFG, 0, 3); /* full speed */
    otg_set(GINTSTS, UINT32_C(0xFFFFFFFF));
    change(DCTL, BIT(1), 0); /* connect */
}

void host_poll(void)
{
    uint32_t what = otg_get(GINTSTS);
    if (what & USB_RESET) {
        otg_set(GINTSTS, USB_RESET);
        start_anew();
    }
    if (what & ENUMERATED) {
        otg_set(GINTSTS, ENUMERATED);
        change(DIEPCTL(0), 3, 0); /* packets of 64 bytes */
    }
    while (otg_get(GINTSTS) & RECEIVED)
        receive();
    if (!configured)
        return;
    if (!(otg_get(DOEPCTL(DATA)) & EP_ENABLE) && RING_BYTES - ring_waiting(&in) > PACKET)
        listen(DATA);
    size_t n = ring_waiting(&out);
    if (n == 0 || otg_get(DIEPCTL(DATA)) & EP_ENABLE || otg_get(DTXFSTS(DATA)) < FIFO_WORDS)
        return; /* nothing to send, or the last is still on its way */
    uint8_t bytes[4 * FIFO_WORDS];
    n = n < sizeof bytes ? n : sizeof bytes;
    n -= n % PACKET == 0; /* a host waits for more after a full packet */
    write_packets(DATA, bytes, ring_take_most(&out, bytes, n));
}

size_t host_read(uint8_t *bytes, size_t most)
{
    return ring_take_most(&in, bytes, most);
}

void phd_send(const uint8_t *frame, size_t n)
{
    if (configured)
        ring_put_whole(&out, frame, n);
}

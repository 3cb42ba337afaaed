/* The registers of the USB core OTG_FS as a device (RM0090, RM0390). */
#ifndef OTG_H
#define OTG_H

#include "registers.h"

#ifndef OTG_MODEL
static inline uint32_t otg_get(uint32_t at) { return REG(0x50000000 + at); }
static inline void otg_set(uint32_t at, uint32_t value) { REG(0x50000000 + at) = value; }
static inline void otg_clock(void) { RCC_AHB2ENR |= BIT(7); }
#else /* in a test, a model of the core */
extern uint32_t (*otg_get)(uint32_t at);
extern void (*otg_set)(uint32_t at, uint32_t value);
static inline void otg_clock(void) {}
#endif

enum {
    GOTGCTL = 0x000, GUSBCFG = 0x00C, GRSTCTL = 0x010, GINTSTS = 0x014, GRXSTSP = 0x020, GRXFSIZ = 0x024,
    DIEPTXF0 = 0x028, GCCFG = 0x038, DIEPTXF1 = 0x104, DIEPTXF2 = 0x108, DCFG = 0x800, DCTL = 0x804, PCGCCTL = 0xE00
};
/* Of an endpoint to the host (IN), and from it (OUT) */
#define DIEPCTL(n) (0x900u + 0x20u * (n))
#define DIEPTSIZ(n) (0x910u + 0x20u * (n))
#define DTXFSTS(n) (0x918u + 0x20u * (n))
#define DOEPCTL(n) (0xB00u + 0x20u * (n))
#define DOEPINT(n) (0xB08u + 0x20u * (n))
#define DOEPTSIZ(n) (0xB10u + 0x20u * (n))
#define FIFO(n) (0x1000u + 0x1000u * (n))

#define USB_RESET BIT(12)   /* of GINTSTS */
#define ENUMERATED BIT(13)
#define RECEIVED BIT(4)
#define EP_ON BIT(15)       /* of DIEPCTL, DOEPCTL */
#define EP_STALL BIT(21)
#define EP_CLEAR_NAK BIT(26)
#define EP_SET_NAK BIT(27)
#define EP_DATA0 BIT(28)
#define EP_ENABLE BIT(31)
#define ONE_PACKET (UINT32_C(1) << 19) /* of DIEPTSIZ, DOEPTSIZ */
#define THREE_SETUPS (UINT32_C(3) << 29)

enum { GOT_DATA = 2, OUT_DONE = 3, SETUP_DONE = 4, GOT_SETUP = 6 }; /* of GRXSTSP */

#endif

/* What became of the supply, the e-stop in the amplifiers' supply, and the watchdog. */
#include "board.h"
#include "pins.h"
#include "registers.h"

enum { MARK = 0x50484431, NOISES = 64 };

/* Below 2.7 V the chip stays in reset; by an option of the flash, which stays. It holds from the next start on. */
static void set_brown_out_level(void)
{
    if ((FLASH_OPTCR & (BIT(2) | BIT(3))) == 0)
        return;
    FLASH_OPTKEYR = UINT32_C(0x08192A3B);
    FLASH_OPTKEYR = UINT32_C(0x4C5D6E7F);
    FLASH_OPTCR &= ~(BIT(2) | BIT(3));
    FLASH_OPTCR |= BIT(1);
    while (FLASH_SR & BIT(16)) {
    }
    FLASH_OPTCR |= BIT(0);
}

/* A number that hardly comes twice: noise of the converter that looks at the chip's own reference for too short a time. */
static uint32_t noise(void)
{
    uint8_t heard[NOISES];
    RCC_APB2ENR |= BIT(8); /* ADC1 */
    ADC_CCR = BIT(23);     /* the reference is channel 17; its clock too fast for a quiet reading */
    ADC_SQR1 = 0;
    ADC_SQR3 = 17;
    ADC_CR2 = BIT(0);
    for (unsigned i = 0; i < NOISES; i++) {
        ADC_CR2 |= BIT(30);
        for (unsigned n = 0; !(ADC_SR & BIT(1)) && n < 10000; n++) {
        }
        heard[i] = (uint8_t)(ADC_DR ^ SYST_CVR);
    }
    ADC_CR2 = 0;
    return phd_crc32(heard, NOISES);
}

/* The number of starts stands in the registers that a battery at VBAT keeps. Without one they are lost with the supply,
 * and the number is drawn anew. */
supply_story supply_begin(void)
{
    supply_story story;
    uint32_t why = RCC_CSR;
    RCC_CSR = why | BIT(24);
    story.after_brown_out = (why & BIT(25)) && !(why & BIT(27)); /* brown-out, and not powered up */
    RCC_APB1ENR |= BIT(28);
    PWR_CR |= BIT(8);
    story.starts = RTC_BKP(0) == MARK ? RTC_BKP(1) + 1 : noise();
    RTC_BKP(1) = story.starts;
    RTC_BKP(0) = MARK;
    set_brown_out_level();
    return story;
}

bool supply_is_cut(void)
{
    return pin_is_high(PIN_ESTOP);
}

void watchdog_begin(void)
{
    IWDG_KR = 0x5555;
    IWDG_PR = 0;   /* 32 kHz / 4, and 17 to 47 kHz in a bad chip */
    IWDG_RLR = 80; /* 10 ms */
    IWDG_KR = 0xCCCC;
}

void watchdog_feed(void)
{
    IWDG_KR = 0xAAAA;
}

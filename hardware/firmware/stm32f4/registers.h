/* The registers of an STM32F405 or F446 that this firmware uses (reference manuals RM0090, RM0390). */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))
#define BIT(n) (UINT32_C(1) << (n))

#ifndef EMULATED /* 1: the emulator has no clock tree and no number of the chip, and its timers know no encoder */
#define EMULATED 0
#endif

/* Reset and clock control, power, flash */
#define RCC_CR REG(0x40023800)
#define RCC_PLLCFGR REG(0x40023804)
#define RCC_CFGR REG(0x40023808)
#define RCC_AHB1ENR REG(0x40023830)
#define RCC_AHB2ENR REG(0x40023834)
#define RCC_APB1ENR REG(0x40023840)
#define RCC_APB2ENR REG(0x40023844)
#define RCC_CSR REG(0x40023874)
#define PWR_CR REG(0x40007000)
#define RTC_BKP(n) REG(0x40002850 + 4 * (n))
#define FLASH_ACR REG(0x40023C00)
#define FLASH_OPTKEYR REG(0x40023C08)
#define FLASH_SR REG(0x40023C0C)
#define FLASH_OPTCR REG(0x40023C14)
#define UNIQUE_ID(n) (EMULATED ? 0 : REG(0x1FFF7A10 + 4 * (n)))

/* Pins; port: 0 is A */
#define GPIO_MODER(port) REG(0x40020000 + 0x400 * (uint32_t)(port))
#define GPIO_OSPEEDR(port) REG(0x40020008 + 0x400 * (uint32_t)(port))
#define GPIO_PUPDR(port) REG(0x4002000C + 0x400 * (uint32_t)(port))
#define GPIO_IDR(port) REG(0x40020010 + 0x400 * (uint32_t)(port))
#define GPIO_BSRR(port) REG(0x40020018 + 0x400 * (uint32_t)(port))
#define GPIO_AFR(port, high) REG(0x40020020 + 0x400 * (uint32_t)(port) + 4 * (uint32_t)(high))

/* Timers */
enum { TIM2 = 0x40000000, TIM3 = 0x40000400, TIM4 = 0x40000800, TIM5 = 0x40000C00, TIM8 = 0x40010400 };
#define TIM_CR1(tim) REG((tim) + 0x00)
#define TIM_SMCR(tim) REG((tim) + 0x08)
#define TIM_DIER(tim) REG((tim) + 0x0C)
#define TIM_SR(tim) REG((tim) + 0x10)
#define TIM_EGR(tim) REG((tim) + 0x14)
#define TIM_CCMR1(tim) REG((tim) + 0x18)
#define TIM_CCMR2(tim) REG((tim) + 0x1C)
#define TIM_CCER(tim) REG((tim) + 0x20)
#define TIM_CNT(tim) (EMULATED ? 0 : REG((tim) + 0x24))
#define TIM_ARR(tim) REG((tim) + 0x2C)
#define TIM_RCR(tim) REG((tim) + 0x30)
#define TIM_CCR(tim, n) REG((tim) + 0x34 + 4 * (uint32_t)(n)) /* n from 0 */
#define TIM_BDTR(tim) REG((tim) + 0x44)

/* Converter 1 */
#define ADC_SR REG(0x40012000)
#define ADC_CR1 REG(0x40012004)
#define ADC_CR2 REG(0x40012008)
#define ADC_SMPR1 REG(0x4001200C)
#define ADC_SQR1 REG(0x4001202C)
#define ADC_SQR3 REG(0x40012034)
#define ADC_JSQR REG(0x40012038)
#define ADC_JDR(n) REG(0x4001203C + 4 * (uint32_t)(n)) /* n from 0 */
#define ADC_DR REG(0x4001204C)
#define ADC_CCR REG(0x40012304)

/* SPI 2 */
#define SPI2_CR1 REG(0x40003800)
#define SPI2_SR REG(0x40003808)
#define SPI2_DR REG(0x4000380C)

/* Serial ports */
enum { USART2 = 0x40004400, USART3 = 0x40004800 };
#define USART_SR(port) REG((port) + 0x00)
#define USART_DR(port) REG((port) + 0x04)
#define USART_BRR(port) REG((port) + 0x08)
#define USART_CR1(port) REG((port) + 0x0C)

/* Independent watchdog */
#define IWDG_KR REG(0x40003000)
#define IWDG_PR REG(0x40003004)
#define IWDG_RLR REG(0x40003008)

/* The processor */
#define SYST_CSR REG(0xE000E010)
#define SYST_RVR REG(0xE000E014)
#define SYST_CVR REG(0xE000E018)
#define NVIC_ENABLE(irq) (REG(0xE000E100 + 4 * ((uint32_t)(irq) / 32)) = BIT((uint32_t)(irq) % 32))
#define NVIC_PRIORITY(irq, level) (*(volatile uint8_t *)(0xE000E400 + (uint32_t)(irq)) = (uint8_t)((level) << 4))
#define SCB_ICSR REG(0xE000ED04)
#define SCB_AIRCR REG(0xE000ED0C)
#define SCB_SHPR3 REG(0xE000ED20)
enum { IRQ_ADC = 18, IRQ_USART2 = 38, IRQ_USART3 = 39, IRQ_TIM8_UP = 44, IRQS = 97 };

enum { CORE_HZ = 168000000, APB1_HZ = 42000000, APB2_TIMER_HZ = 168000000 };

static inline uint32_t masked(void) /* interrupts off; what to give `unmasked` */
{
    uint32_t before;
    __asm volatile("mrs %0, primask\n cpsid i" : "=r"(before)::"memory");
    return before;
}

static inline void unmasked(uint32_t before)
{
    __asm volatile("msr primask, %0" ::"r"(before) : "memory");
}

#endif

/* Start of a Cortex-M7 in QEMU, with its floating-point unit and semihosting. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

extern void initialise_monitor_handles(void);
extern char __bss_start__[], __bss_end__[];
int main(void);

void reset(void)
{
    char *p;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20;
    __asm volatile("dsb\nisb");
    for (p = __bss_start__; p < __bss_end__; p++) *p = 0;
    initialise_monitor_handles();
    exit(main());
}

void fault(void)
{
    printf("fault\n");
    exit(3);
}

__attribute__((section(".vectors"), used)) void *const vectors[16] = {
    (void *)0x20400000, (void *)reset, (void *)fault, (void *)fault,
    (void *)fault, (void *)fault, (void *)fault,
};
void _init(void) {}
void _fini(void) {}

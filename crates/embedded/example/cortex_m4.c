/* The loop on a Cortex-M4F that QEMU has (mps2-an386): vectors, start, and text by semihosting. */

#include <stdint.h>

extern uint32_t stack_top, data_from, data_begin, data_end, bss_begin, bss_end;
int main(void);

static void host(int operation, const void *with) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void print(const char *text) {
    host(0x04, text);
}

static void end(int code) {
    /* Ended as a program does, with this code. */
    const uint32_t with[2] = {0x20026, (uint32_t)code};
    host(0x20, with);
    for (;;) {
    }
}

void start(void) {
    uint32_t *from = &data_from;
    for (uint32_t *to = &data_begin; to < &data_end;) *to++ = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    *(volatile uint32_t *)0xe000ed88u |= 0xfu << 20; /* the floating-point unit */
    __asm__ volatile("dsb\n isb");
    end(main());
}

static void fault(void) {
    print("fault\n");
    end(2);
}

/* The first place holds the end of the stack, each other one a function. */
union vector {
    const void *stack;
    void (*run)(void);
};

__attribute__((section(".vectors"), used)) static const union vector vectors[] = {
    {&stack_top}, {.run = start}, {.run = fault}, {.run = fault}, {.run = fault}, {.run = fault}, {.run = fault}};

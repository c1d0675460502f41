/* A loop with a gap of 2 in its valve: PID, detector and compensation, in f32 and in f64, on a microcontroller or on a PC. Both print the
 * same lines: each number in hundredths, and the bits of all outputs as one number. */

#include "glapp_embedded.h"

#include <stdint.h>

void print(const char *text);

static void number(const char *name, long value) {
    char text[24];
    int at = 23, negative = value < 0;
    unsigned long rest = negative ? (unsigned long)-value : (unsigned long)value;
    text[at] = 0;
    do {
        text[--at] = (char)('0' + rest % 10);
        rest /= 10;
    } while (rest);
    if (negative) text[--at] = '-';
    print(name);
    print(text + at);
}

static void bits(const char *name, uint32_t value) {
    char text[9];
    for (int i = 0; i < 8; i++) text[i] = "0123456789abcdef"[value >> (28 - 4 * i) & 15];
    text[8] = 0;
    print(name);
    print(text);
}

static uint32_t mixed(uint32_t sum, const void *of, unsigned length) {
    const unsigned char *byte = (const unsigned char *)of;
    while (length--) sum = (sum ^ *byte++) * 16777619u;
    return sum;
}

#define RUN(real, suffix)                                                                                                      \
    static int run_##suffix(void) {                                                                                            \
        static glapp_pid_##suffix pid;                                                                                         \
        static glapp_detector_##suffix detector;                                                                               \
        static glapp_compensation_##suffix compensation;                                                                       \
        glapp_pid_settings_##suffix for_pid;                                                                                   \
        glapp_detector_settings_##suffix for_detector;                                                                         \
        glapp_compensation_settings_##suffix for_compensation;                                                                 \
        const real h = (real)0.1, none = (real)(0.0 / 0.0), load = 5, gap = 2;                                                 \
        real op = 50, valve = 50, first = 50, pv = 50, u_ff = 0;                                                               \
        glapp_estimate_##suffix found;                                                                                         \
        uint32_t sum = 2166136261u, noise = 1, flags = 0;                                                                      \
        int wrong = 0, standing = 1;                                                                                           \
        glapp_pid_defaults_##suffix(2, 2, 0, &for_pid);                                                                        \
        for_pid.low = 0;                                                                                                       \
        for_pid.high = 100;                                                                                                    \
        for_pid.tf = (real)0.2;                                                                                                \
        wrong |= glapp_pid_begin_##suffix(&pid, &for_pid, 50);                                                                 \
        glapp_detector_defaults_##suffix(2, 2, 0, h, &for_detector);                                                           \
        for_detector.kp = 1;                                                                                                   \
        for_detector.tf = (real)0.2;                                                                                           \
        wrong |= glapp_detector_begin_##suffix(&detector, &for_detector);                                                      \
        glapp_compensation_defaults_##suffix(2, 2, gap, &for_compensation);                                                    \
        for_compensation.share = (real)0.8;                                                                                    \
        for_compensation.op_low = 0;                                                                                           \
        for_compensation.op_high = 100;                                                                                        \
        wrong |= glapp_compensation_begin_##suffix(&compensation, &for_compensation);                                          \
        for (int scan = 0; scan < 12000; scan++) {                                                                             \
            noise = noise * 1664525u + 1013904223u;                                                                            \
            real seen = pv + (real)0.02 * ((real)(int32_t)(noise >> 16) / (real)32768 - 1);                                     \
            wrong |= glapp_pid_update_##suffix(&pid, h, 50, seen, u_ff, none, GLAPP_AUTO, &op);                                \
            flags = (uint32_t)glapp_pid_told_##suffix(&pid, 0, op);                                                            \
            glapp_detector_update_##suffix(&detector, h, 50, seen, op - u_ff, flags);                                          \
            standing = glapp_compensation_update_##suffix(&compensation, h, 50 - seen, op - u_ff, none, scan > 8000, flags, &u_ff); \
            if (scan == 8000) {                                                                                                \
                int shown = glapp_detector_estimate_##suffix(&detector, &found);                                               \
                number("shown ", shown);                                                                                       \
                number(", width in hundredths ", (long)(found.width * 100));                                                   \
                number(", accepted ", (long)found.accepted);                                                                   \
                print("\n");                                                                                                   \
            }                                                                                                                  \
            if (op - gap / 2 > valve) valve = op - gap / 2;                                                                    \
            if (op + gap / 2 < valve) valve = op + gap / 2;                                                                    \
            first += (valve + load - first) * h / 3;                                                                           \
            pv += (first - pv) * h;                                                                                            \
            sum = mixed(sum, &op, sizeof op);                                                                                  \
        }                                                                                                                      \
        number("standing ", standing);                                                                                         \
        bits(", all outputs ", sum);                                                                                           \
        number(", wrong ", wrong);                                                                                             \
        print("\n");                                                                                                           \
        for_pid.ti = 0;                                                                                                        \
        wrong |= glapp_pid_begin_##suffix(&pid, &for_pid, 50) != 2; /* ti is parameter 2 */                                    \
        pid = (glapp_pid_##suffix){{0}};                                                                                       \
        wrong |= glapp_pid_told_##suffix(&pid, 0, 0) != GLAPP_NOT_BEGUN;                                                       \
        wrong |= glapp_detector_update_##suffix(0, h, 0, 0, 0, 0) != GLAPP_BAD_POINTER;                                        \
        return wrong;                                                                                                          \
    }

RUN(float, f32)
RUN(double, f64)

int main(void) {
    print("f32: ");
    int wrong = run_f32();
    print("f64: ");
    wrong |= run_f64();
    print(wrong ? "wrong\n" : "done\n");
    return wrong;
}

/* glapp for microcontrollers: detector, compensation and PID, in f32 and in f64. No allocation, no operating system, no global memory.
 *
 * The memory of a block is the caller's: a glapp_detector_f32 that stays where it is, in static memory or on the stack of a task that does not
 * end. `..._defaults` fills settings, `..._begin` checks them and begins the block, `..._update` takes one sample. One block is used by one
 * task at a time; two blocks have nothing in common.
 *
 * Each function gives 0 or more where all is well, GLAPP_BAD_POINTER or GLAPP_NOT_BEGUN (below 0) where its pointers are wrong. `..._begin`
 * gives 0, or the number of the parameter that is out of bounds (docs/catalogue.md, "parameters"): the block then is not begun, and one
 * that was begun before goes on as it is. Of two limits both are given, or none.
 *
 * What is not known is NaN. Units: [OP unit], [PV unit], [s]. K is the gain of the controller in ideal form.
 * Flags, added up: 1 not in automatic, 2 bad quality, 4 at the lower limit, 8 at the upper limit; others are ignored. */

#ifndef GLAPP_EMBEDDED_H
#define GLAPP_EMBEDDED_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GLAPP_BAD_POINTER (-1)
#define GLAPP_NOT_BEGUN (-2)

#define GLAPP_NOT_AUTO 1u
#define GLAPP_BAD 2u
#define GLAPP_AT_LOW 4u
#define GLAPP_AT_HIGH 8u

enum { GLAPP_MANUAL = 0, GLAPP_AUTO = 1 };

/* Memory of a block, in words of 8 bytes; its inside is no affair of the caller's. */
typedef struct { uint64_t memory[100]; } glapp_detector_f32;
typedef struct { uint64_t memory[184]; } glapp_detector_f64;
typedef struct { uint64_t memory[64]; } glapp_compensation_f32;
typedef struct { uint64_t memory[96]; } glapp_compensation_f64;
typedef struct { uint64_t memory[48]; } glapp_pid_f32;
typedef struct { uint64_t memory[64]; } glapp_pid_f64;

#define GLAPP_BLOCKS(real, suffix)                                                                                                   \
    typedef struct {                                                                                                                 \
        real k, ti, td;         /* of the controller, td 0: PI, NaN: not known */                                                    \
        real b;                 /* its setpoint weight, 0 to 1 */                                                                    \
        real kp;                /* process gain [PV unit/OP unit], NaN: not known */                                                 \
        real pv_span, op_span;  /* NaN: not known */                                                                                 \
        real op_low, op_high;   /* limits of OP, NaN: not known */                                                                   \
        real tf;                /* filter of PV [s] */                                                                               \
        real max_h;             /* a longer time between samples is a gap [s] */                                                     \
        uint32_t n;             /* length of the filter of detections, odd, 1 to 31 */                                               \
        uint32_t integrating;   /* 1: the process integrates */                                                                      \
    } glapp_detector_settings_##suffix;                                                                                              \
    typedef struct {                                                                                                                 \
        real width;             /* total width of the dead band [OP unit], NaN: no detection yet */                                  \
        real low, high;         /* the narrowest and the widest detection that it is made of */                                      \
        real noise_floor;       /* no width below this can be told from noise [OP unit], NaN: not known */                           \
        uint32_t count;         /* detections in the window; fewer than n: provisional */                                            \
        uint32_t accepted;      /* detections so far */                                                                              \
    } glapp_estimate_##suffix;                                                                                                       \
    typedef struct {                                                                                                                 \
        real k, ti;             /* of the controller */                                                                              \
        real size;              /* width of the gap, 0 or greater [OP unit] */                                                       \
        real share;             /* share of it to compensate, 0 to 1 */                                                              \
        real limit;             /* greatest width [OP unit] */                                                                       \
        real band;              /* how far OP goes back in a reversal, for way 3 [OP unit] */                                        \
        real tf;                /* filter of OP [s] */                                                                               \
        real rate;              /* greatest rate of u_FF [OP unit/s] */                                                              \
        real release;           /* time in which it is taken away [s] */                                                             \
        real travel, reversals; /* budgets in any hour; 1e37: none */                                                                \
        real watch;             /* time over which the loop is compared [s] */                                                       \
        real op_low, op_high;   /* limits of OP, NaN: none */                                                                        \
        uint32_t way;           /* 1 sign of the error, 2 derivative, 3 inverse with a noise band */                                 \
        uint32_t withdraw;      /* 1: a loop that is worse than before withdraws it */                                               \
        uint32_t use_estimate;  /* 1: the on-line estimate may make the size smaller */                                              \
    } glapp_compensation_settings_##suffix;                                                                                          \
    typedef struct {                                                                                                                 \
        real k, ti, td, b, c;   /* ideal form, setpoint weights */                                                                   \
        real tf;                /* filter of PV [s] */                                                                               \
        real low, high;         /* limits of the output [OP unit] */                                                                 \
        real rate;              /* the fastest that it moves [OP unit/s] */                                                          \
        real max_h;             /* a longer time between scans is a gap [s] */                                                       \
    } glapp_pid_settings_##suffix;                                                                                                   \
                                                                                                                                     \
    int32_t glapp_detector_defaults_##suffix(real k, real ti, real td, real h, glapp_detector_settings_##suffix *settings);          \
    int32_t glapp_detector_begin_##suffix(glapp_detector_##suffix *detector, const glapp_detector_settings_##suffix *settings);      \
    /* 1 where a half-period ended with this sample. op NaN: not known. */                                                           \
    int32_t glapp_detector_update_##suffix(glapp_detector_##suffix *detector, real h, real sp, real pv, real op, uint32_t flags);    \
    /* 1 where the width is known and not below the noise limit: only then believe it. */                                            \
    int32_t glapp_detector_estimate_##suffix(glapp_detector_##suffix *detector, glapp_estimate_##suffix *estimate);                  \
                                                                                                                                     \
    int32_t glapp_compensation_defaults_##suffix(real k, real ti, real size, glapp_compensation_settings_##suffix *settings);        \
    int32_t glapp_compensation_begin_##suffix(glapp_compensation_##suffix *compensation,                                             \
                                              const glapp_compensation_settings_##suffix *settings);                                 \
    /* e = SP - PV; u: OP without u_ff; d_hat: on-line estimate of the whole gap, NaN: none. The detector's width is the whole gap   \
     * only while u_ff is 0, then what is left of it. So give the width of the sample before enable, or always NaN: one that was     \
     * there and is NaN takes u_ff to 0 (standing 7). Off while enable is 0; enable counts                                           \
     * once it has been 0, so that compensation does not begin by itself after a power cut. u_ff is to be                             \
     * added to the output in the next scan. Gives the standing: 0 active, else why not (docs/catalogue.md, "standings"). */         \
    int32_t glapp_compensation_update_##suffix(glapp_compensation_##suffix *compensation, real h, real e, real u, real d_hat,        \
                                               uint32_t enable, uint32_t flags, real *u_ff);                                         \
                                                                                                                                     \
    int32_t glapp_pid_defaults_##suffix(real k, real ti, real td, glapp_pid_settings_##suffix *settings);                            \
    int32_t glapp_pid_begin_##suffix(glapp_pid_##suffix *pid, const glapp_pid_settings_##suffix *settings, real start);              \
    /* mode GLAPP_MANUAL or GLAPP_AUTO; manual NaN: as it was; ff: feed-forward. */                                                  \
    int32_t glapp_pid_update_##suffix(glapp_pid_##suffix *pid, real h, real sp, real pv, real ff, real manual, uint32_t mode,        \
                                      real *output);                                                                                 \
    /* After each update: what the valve tells, its flags and the value in effect. Gives the flags of the loop, for the detector. */ \
    int32_t glapp_pid_told_##suffix(glapp_pid_##suffix *pid, uint32_t flags, real tracking);

GLAPP_BLOCKS(float, f32)
GLAPP_BLOCKS(double, f64)

#ifdef __cplusplus
}
#endif

#endif

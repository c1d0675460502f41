/* glapp: backlash (dead band) in control loops. The interface for C and C++; docs/c.md tells how it is used.
 *
 * Every function that can fail returns a code: 0 or above where it is done, below 0 where it is not. glapp_error() then
 * tells what was wrong: the name, its value, its bound. Nothing is thrown, and no signal is raised.
 *
 * Every pointer is looked at: NULL where something must stand, and an address that does not go with its type, are refused.
 * A handle is a number in the form of a pointer. It is never followed: one that was freed, or is of another kind,
 * is refused. What no library can see is whether an array is as long as you say, and whether a text is yours to read.
 *
 * Any thread may call any function; calls with one handle wait for each other. Texts are UTF-8 and end in a 0.
 */
#ifndef GLAPP_H
#define GLAPP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this interface: greater wherever a program that was built before would no longer do. Ask once, at the
 * beginning, whether glapp_abi() == GLAPP_ABI: else the library is not the one of this header. */
#define GLAPP_ABI 1
uint32_t glapp_abi(void);

/* The version of glapp, as "0.1.0". */
const char *glapp_version(void);

/* What went wrong the last time that a function of this header failed in this thread. Good until the next one fails in it. */
const char *glapp_error(void);

#define GLAPP_OK 0           /* done */
#define GLAPP_YES 1          /* done, and there is something: a half-period ended, an estimate is there */
#define GLAPP_BAD_POINTER -1 /* a pointer is NULL where it must not be, or does not lie as its type asks */
#define GLAPP_BAD_HANDLE -2  /* a handle that was never given, is of another kind, or was freed */
#define GLAPP_BAD_LENGTH -3  /* a length that no array can have */
#define GLAPP_BAD_TEXT -4    /* a text that is no UTF-8, or does not end within 4096 bytes */
#define GLAPP_REFUSED -5     /* a setting, name or value that is refused */
#define GLAPP_BROKEN -6      /* a fault inside the library; the handle can only be freed */

/* A name and its value, in the unit of the catalogue, a page of the documentation. */
typedef struct glapp_setting {
    const char *name;
    double value;
} glapp_setting;

/* ---- A detector: samples in, half-periods and an estimate out. It needs SP and PV, and takes OP where it is known. ---- */

typedef struct glapp_detector glapp_detector;

/* Flags of a sample, to be added up. */
#define GLAPP_FLAG_NOT_AUTO 1 /* the controller is not in automatic */
#define GLAPP_FLAG_BAD 2      /* a value is of bad quality */
#define GLAPP_FLAG_AT_LOW 4   /* OP is at its lower limit */
#define GLAPP_FLAG_AT_HIGH 8  /* OP is at its upper limit */

/* Reasons for which a half-period is no detection, in the order in which the first is named. */
#define GLAPP_REASON_ACCEPTED 0
#define GLAPP_REASON_GAP 1         /* samples are missing */
#define GLAPP_REASON_BAD_QUALITY 2 /* a value is bad */
#define GLAPP_REASON_NOT_AUTO 3    /* the controller was not in automatic */
#define GLAPP_REASON_SATURATED 4   /* OP was at a limit */
#define GLAPP_REASON_TOO_SHORT 5   /* shorter than 5 Ti */
#define GLAPP_REASON_NOT_SQUARE 6  /* (5.2) */
#define GLAPP_REASON_UNEVEN 7      /* (5.4) */
#define GLAPP_REASON_SP_MOVED 8    /* (5.5) */
#define GLAPP_REASON_TOO_SMALL 9   /* (5.1) */

/* One half-period. A number that is not known is NaN. */
typedef struct glapp_half_period {
    double t_start;      /* time of its first sample [s] */
    double t_end;        /* time of the sample that ended it, or of the last one before a gap [s] */
    double delta_t;      /* duration [s] */
    double delta_y;      /* mean distance of PV to SP [PV unit] */
    double e_max;        /* largest distance [PV unit] */
    double delta_sp;     /* range of SP [PV unit] */
    double delta_u;      /* K/Ti times delta_y times delta_t (7.5) [OP unit] */
    double op_travel;    /* OP's own travel in the direction of the integral action [OP unit]; 0 where OP is not known */
    double d;            /* width (2.4) [OP unit] */
    double d_hat;        /* estimate after it [OP unit]; NaN while there is none, or it is below the noise limit */
    double noise_floor;  /* the noise limit [OP unit] */
    uint32_t samples;    /* number of samples */
    uint32_t detections; /* detections in the window behind the estimate */
    uint32_t mask;       /* all conditions that failed: 1 for reason 1, 2 for reason 2, 4 for reason 3, ... 0: a detection */
    uint32_t reason;     /* the first of them */
} glapp_half_period;

/* What the detections say of the width. */
typedef struct glapp_estimate {
    double value;       /* [OP unit] */
    double low;         /* smallest detection that was kept [OP unit] */
    double high;        /* largest one [OP unit] */
    double noise_floor; /* the noise limit [OP unit]; NaN where it is not known */
    uint32_t count;     /* detections in the window; it is provisional below the setting n */
    uint32_t kept;      /* those within 80 to 120 % of their median */
} glapp_estimate;

/* Makes a detector. `settings` are `count` names and values: k, ti and h [s], the usual time between two samples, must be there.
 * td, b, kp, pv_span, op_span, integrating, tf, n, max_h, op_low with op_high may be. So may the conditions of the safety
 * net, each 1 (asked) or 0 (not). */
int32_t glapp_detector_new(const glapp_setting *settings, size_t count, glapp_detector **detector);

/* Takes the sample at the time t [s]. `op` may be NULL: not known. Returns GLAPP_YES where it ended a half-period, which then stands
 * in `ended`; else `ended` stays as it was. */
int32_t glapp_detector_update(glapp_detector *detector, double t, double sp, double pv, const double *op, uint32_t flags,
                              glapp_half_period *ended);

/* What the detections say so far. Returns GLAPP_YES where there is an estimate above the noise limit; else `estimate` stays as it was. */
int32_t glapp_detector_estimate(glapp_detector *detector, glapp_estimate *estimate);

int32_t glapp_detector_free(glapp_detector *detector);

/* ---- A graph of modules: a PID with the detector inside, compensation, an autotuner, a simulated process. ---- */

typedef struct glapp_graph glapp_graph;

/* A module: its name in the graph, its kind as "PidAdvanced", and its parameters by name. docs/modules.md has all kinds. */
typedef struct glapp_module {
    const char *name;
    const char *kind;
    const glapp_setting *settings;
    size_t count;
} glapp_module;

/* What a compensation does, or why it does nothing: the variable `standing`. */
#define GLAPP_STANDING_ACTIVE 0
#define GLAPP_STANDING_NOT_ENABLED 1
#define GLAPP_STANDING_NOT_AUTO 2
#define GLAPP_STANDING_BAD_QUALITY 3
#define GLAPP_STANDING_OVER_COMPENSATED 4
#define GLAPP_STANDING_TOO_MANY_REVERSALS 5
#define GLAPP_STANDING_TOO_MUCH_TRAVEL 6
#define GLAPP_STANDING_ESTIMATE_LOST 7
#define GLAPP_STANDING_AT_LIMIT 8
#define GLAPP_STANDING_TOO_SMALL 9
#define GLAPP_STANDING_WAITING 10
#define GLAPP_STANDING_WORSE 11
#define GLAPP_STANDING_TOO_LATE 12
#define GLAPP_STANDING_NOT_FOLLOWED 13
#define GLAPP_STANDING_NO_ESTIMATE 14

/* Makes a graph of `count` modules with the scan time h [s], connected by `wire_count` wires as "pid -> gap -> process -> pid.pv". */
int32_t glapp_graph_new(double h, const glapp_module *modules, size_t count, const char *const *wires, size_t wire_count,
                        glapp_graph **graph);

/* One scan, h [s] after the one before: the time that has really passed. */
int32_t glapp_graph_scan(glapp_graph *graph, double h);

/* Sets a parameter or variable, as "pid.k", "pid.compensate", "pv.value". NaN as the value of an Input is a bad value. A
 * value out of its bounds is refused, and all stays as it was. */
int32_t glapp_graph_set(glapp_graph *graph, const char *path, double value);

/* Reads one, as "pid.out", "pid.d_hat", "pid.standing". A number that is not known is NaN. */
int32_t glapp_graph_get(glapp_graph *graph, const char *path, double *value);

int32_t glapp_graph_free(glapp_graph *graph);

/* ---- The fit: width of the gap with its 95 % interval, from OP and PV of a recording. ---- */

/* What it says of the valve. */
#define GLAPP_VERDICT_BACKLASH 1    /* a gap */
#define GLAPP_VERDICT_STICTION 2    /* a valve that sticks and jumps, no gap beside it */
#define GLAPP_VERDICT_BOTH 3        /* both */
#define GLAPP_VERDICT_OSCILLATION 4 /* a clean sinusoid; not given here, where nobody has looked for one */
#define GLAPP_VERDICT_SOUND 5       /* no gap wider than `high` */
#define GLAPP_VERDICT_AT_LEAST 6    /* a gap wider than `low` */
#define GLAPP_VERDICT_CANNOT_TELL 7 /* the recording cannot tell; `why` is the word for it */

/* Columns of a recording, all of one length, in the order of time. NaN is a missing value; a row without an SP that is recorded
 * is bad. */
typedef struct glapp_columns {
    size_t rows;
    const double *t;        /* time [s] */
    const double *sp;       /* setpoint [PV unit]; NULL: not recorded */
    const double *pv;       /* process value [PV unit] */
    const double *op;       /* output of the controller [OP unit] */
    const double *position; /* position of the valve [its unit]; NULL: not recorded */
    const uint8_t *flags;   /* sums of the flags above; NULL: all 0 */
} glapp_columns;

/* The answer. A number that is not known is NaN. */
typedef struct glapp_width {
    double d;             /* most likely total width [OP unit] */
    double low;           /* lower limit of its 95 % interval [OP unit] */
    double high;          /* upper limit [OP unit]; NaN: the recording gives none */
    double jump;          /* slip jump [OP unit]; 0 for mere backlash */
    double lr_no_gap;     /* likelihood ratio of no gap against the best width */
    double lr_needed;     /* what it must exceed for a gap */
    double kp;            /* process gain [PV unit/OP unit]; of one that integrates [PV unit/(OP unit s)] */
    double dead_time;     /* dead time of the process [s] */
    double lag;           /* its lags together [s] */
    uint32_t integrating; /* 1: the process integrates */
    uint32_t verdict;     /* GLAPP_VERDICT_... */
    char why[32];         /* what decided, in the word of Python's Fit.why */
} glapp_width;

/* Fits the width. `sign` is that of the process gain: 1, -1, or 0 where it is not known. A long recording takes seconds to
 * minutes, and all processors. Where memory runs out, the process ends. */
int32_t glapp_fit(const glapp_columns *columns, double sign, glapp_width *width);

/* ---- A step test: OP stepped in manual twice one way and once back, each step held until PV stands still. ---- */

/* Reads dead band and process gain off the step test in a recording. SP is not needed; without OP the answer says so. Settings:
 * "manual" 1: all rows were made in manual, 0 (default): those with GLAPP_FLAG_NOT_AUTO; "integrating" 1: the process integrates;
 * "op_span": width of OP's span [OP unit]; "positioner_dead_band": what the positioner is set to [% of travel];
 * "width": width in question [OP unit], of which "asked" then says whether the test has decided it.
 * The answer is written to `json`, which has `room` bytes, as a text in JSON that ends in a 0 (docs/step-test.md has its
 * fields); `needed` gets the bytes that it takes. Where `room` is less, nothing is written: GLAPP_BAD_LENGTH. */
int32_t glapp_step_test(const glapp_columns *columns, const glapp_setting *settings, size_t count, char *json, size_t room,
                        size_t *needed);

/* ---- All of it: a recording in, the answer document out. ---- */

/* Judges a recording, finds what is not given, and fits the width. `task` is a text in JSON, at most 4095 bytes: {} asks for
 * everything and knows nothing; docs/c.md has all of its keys, such as "controller", "kp", "op_span", "acceptable". OP, SP and
 * the position may be NULL. The answer is written to `json` as by glapp_step_test: one loop of the document of `glapp analyze
 * --json`, with codes and numbers in place of sentences; its `answer` is the one answer. 64 kB are enough but for very long
 * recordings. */
int32_t glapp_analyze(const glapp_columns *columns, const char *task, char *json, size_t room, size_t *needed);

/* ---- Words: a code with its numbers as a person reads it. ---- */

/* Puts a message, {"code": "step_test.first_holds", "numbers": {"read": 40, "left": 3}}, into a sentence; both texts have at most
 * 4095 bytes. Each of `messages` in the document of glapp_analyze is one; other codes have their subject before them: "quality.",
 * "step_test." ... `reader` may be NULL, else {"name": loop, "pv_unit": "bar", "op_unit": "%", "t0": local time of t = 0 [us since 1970], "first_row": 2}, any of them.
 * The sentence is written to `text` as glapp_step_test writes its answer. */
int32_t glapp_text(const char *message, const char *reader, char *text, size_t room, size_t *needed);

#ifdef __cplusplus
}
#endif

#endif

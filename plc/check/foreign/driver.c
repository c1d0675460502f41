/* The library under another maker's compiler, beside what the tests beside the core have left (src/trace.rs): pins are set, the block
 * is called, and what it shows is compared with what the core showed, to the bit. C for matiec, C++ for STruC++. `table.inc` is written by
 * the example `foreign`, POUS.c or out.cpp by the compiler.
 *
 *     driver compare < LIST    one line a block: traces, scans, numbers, how many of other bits, how many off by more than 1E-3 of
 *                              1 + the number, the largest share
 *     driver cost N < LIST     one line a block: scans, mean and longest time of a scan in us, each the shortest of N, and its bytes
 *     driver self-test         Done, Passed, Exact, Block and Off of GlappSelfTest
 *
 * LIST has the path of a trace on each line; those of the other build are left out. */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#ifdef __cplusplus
#include <new>
#include "out.cpp"
using namespace strucpp;
#else
#include "iec_std_lib.h"
#include "accessor.h"
#include "POUS.h"
#include "POUS.c"
#endif

struct variable {
    const char *path;
    char type;
    int retained;
};

struct block {
    const char *name;
    size_t size;
    int count;
    const struct variable *of;
    void (*make)(void *);
    void (*call)(void *);
    void *(*place)(void *, int);
};

#include "table.inc"

#define BLOCKS ((int)(sizeof blocks / sizeof *blocks))
enum { SET, READ, SCAN, POWER_CUT };

struct trace {
    const struct block *block;
    int count;
    int *pins;
    const unsigned char *events, *end;
    unsigned char *bytes;
};

static void fail(const char *what, const char *of) {
    fprintf(stderr, "%s: %s\n", of, what);
    exit(2);
}

static int find(const struct block *block, const char *path) {
    for (int i = 0; i < block->count; i++) {
        if (strcmp(block->of[i].path, path) == 0) return i;
    }
    fail("no such variable", path);
    return 0;
}

/* No trace where it is one of the other build. */
static int open_trace(const char *path, struct trace *trace) {
    FILE *file = fopen(path, "rb");
    if (!file) fail("cannot be opened", path);
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    trace->bytes = (unsigned char *)malloc((size_t)size + 1);
    if (fread(trace->bytes, 1, (size_t)size, file) != (size_t)size) fail("cannot be read", path);
    fclose(file);
    unsigned char *line = (unsigned char *)memchr(trace->bytes, '\n', (size_t)size);
    if (!line) fail("not a trace", path);
    *line = 0;
    trace->events = line + 1;
    trace->end = trace->bytes + size;
    char *word = strtok((char *)trace->bytes, " ");
    trace->block = 0;
    for (int i = 0; i < BLOCKS; i++) {
        if (strcmp(blocks[i].name, word) == 0) trace->block = &blocks[i];
    }
    if (!trace->block) fail("no such block", word);
    if (strcmp(strtok(0, " "), BUILD) != 0) {
        free(trace->bytes);
        return 0;
    }
    trace->pins = 0;
    trace->count = 0;
    while ((word = strtok(0, " "))) {
        trace->pins = (int *)realloc(trace->pins, sizeof(int) * (size_t)(trace->count + 1));
        trace->pins[trace->count++] = find(trace->block, word);
    }
    return 1;
}

static double get(const void *at, char type) {
    switch (type) {
    case 'B': return *(const unsigned char *)at != 0;
    case 'I': return *(const int16_t *)at;
    case 'D': return *(const int32_t *)at;
    case 'R': return *(const float *)at;
    default: return *(const double *)at;
    }
}

static void set(void *at, char type, double value) {
    switch (type) {
    case 'B': *(unsigned char *)at = value != 0.0; break;
    case 'I': *(int16_t *)at = (int16_t)value; break;
    case 'D': *(int32_t *)at = (int32_t)value; break;
    case 'R': *(float *)at = (float)value; break;
    default: *(double *)at = value;
    }
}

static void *made(const struct block *block) {
    void *memory = calloc(1, block->size);
    block->make(memory);
    return memory;
}

/* All but what is retained begins anew. */
static void *after_power_cut(const struct block *block, void *memory) {
    void *fresh = made(block);
    for (int i = 0; i < block->count; i++) {
        char type = block->of[i].type;
        if (block->of[i].retained) set(block->place(fresh, i), type, get(block->place(memory, i), type));
    }
    free(memory);
    return fresh;
}

struct count {
    long traces, scans, numbers, other, beyond;
    double largest, most, sum;
};

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

/* Plays a trace; `times` has a place for each scan, where the shortest time stays. */
static void play(const struct trace *trace, struct count *count, double *times, const char *path) {
    const struct block *block = trace->block;
    void *memory = made(block);
    void **at = (void **)malloc(sizeof(void *) * (size_t)(trace->count + 1));
    for (int i = 0; i < trace->count; i++) at[i] = block->place(memory, trace->pins[i]);
    long scan = 0;
    for (const unsigned char *event = trace->events; event < trace->end;) {
        int kind = *event++;
        if (kind == SCAN) {
            double began = times ? now() : 0.0;
            block->call(memory);
            if (times) {
                double took = now() - began;
                if (took < times[scan]) times[scan] = took;
            }
            scan++;
        } else if (kind == POWER_CUT) {
            memory = after_power_cut(block, memory);
            for (int i = 0; i < trace->count; i++) at[i] = block->place(memory, trace->pins[i]);
        } else {
            int pin = event[0] | event[1] << 8;
            double value;
            memcpy(&value, event + 2, sizeof value);
            event += 10;
            char type = block->of[trace->pins[pin]].type;
            if (kind == SET) {
                set(at[pin], type, value);
            } else if (!times) {
                double got = get(at[pin], type);
                count->numbers++;
                if (memcmp(&got, &value, sizeof value) != 0) {
                    double off = got > value ? got - value : value - got;
                    double share = off / (1.0 + (value < 0.0 ? -value : value));
                    if (count->other++ == 0) {
                        fprintf(stderr, "%s, %s, scan %ld: %s is %.17g instead of %.17g\n", path, block->name, scan,
                            block->of[trace->pins[pin]].path, got, value);
                    }
                    if (!(share <= 1e-3)) count->beyond++;
                    if (!(share <= count->largest)) count->largest = share;
                }
            }
        }
    }
    if (!times) {
        count->traces++;
        count->scans += scan;
    }
    free(at);
    free(memory);
}

static long scans_of(const struct trace *trace) {
    long scans = 0;
    for (const unsigned char *event = trace->events; event < trace->end;) {
        int kind = *event++;
        if (kind == SCAN) scans++;
        if (kind == SET || kind == READ) event += 10;
    }
    return scans;
}

static void self_test(void) {
    const struct block *block = 0;
    for (int i = 0; i < BLOCKS; i++) {
        if (strcmp(blocks[i].name, "GlappSelfTest") == 0) block = &blocks[i];
    }
    void *memory = made(block);
    for (int i = 0; i < 401; i++) block->call(memory);
    const char *shown[] = {"Done", "Passed", "Exact", "Block", "Off"};
    for (int i = 0; i < 5; i++) {
        int pin = find(block, shown[i]);
        printf("%s%.9g", i ? "\t" : "", get(block->place(memory, pin), block->of[pin].type));
    }
    printf("\n");
    free(memory);
}

int main(int argc, char **argv) {
    static struct count counts[BLOCKS];
    if (argc > 1 && strcmp(argv[1], "self-test") == 0) {
        self_test();
        return 0;
    }
    int cost = argc > 2 && strcmp(argv[1], "cost") == 0;
    int repeats = cost ? atoi(argv[2]) : 1;
    /* What asking for the time takes by itself. */
    double clock = 1e9;
    for (int i = 0; i < 1000; i++) {
        double began = now(), took = now() - began;
        if (took < clock) clock = took;
    }
    char path[4096];
    while (fgets(path, sizeof path, stdin)) {
        struct trace trace;
        path[strcspn(path, "\n")] = 0;
        if (!open_trace(path, &trace)) continue;
        struct count *count = &counts[trace.block - blocks];
        if (cost) {
            long scans = scans_of(&trace);
            double *times = (double *)malloc(sizeof(double) * (size_t)(scans + 1));
            for (long k = 0; k < scans; k++) times[k] = 1e9;
            for (int k = 0; k < repeats; k++) play(&trace, count, times, path);
            for (long k = 0; k < scans; k++) {
                double took = times[k] > clock ? times[k] - clock : 0.0;
                count->sum += took;
                if (took > count->most) count->most = took;
            }
            count->scans += scans;
            free(times);
        } else {
            play(&trace, count, 0, path);
        }
        free(trace.pins);
        free(trace.bytes);
    }
    for (int i = 0; i < BLOCKS; i++) {
        struct count *count = &counts[i];
        if (cost && count->scans) {
            double mean = count->sum / (double)count->scans;
            printf("%s\t%ld\t%.4f\t%.4f\t%zu\n", blocks[i].name, count->scans, mean, count->most, blocks[i].size);
        } else if (count->traces) {
            printf("%s\t%ld\t%ld\t%ld\t%ld\t%ld\t%.3g\n", blocks[i].name, count->traces, count->scans, count->numbers, count->other,
                count->beyond, count->largest);
        }
    }
    return 0;
}

/* A loop put together from modules, and changed while it runs: the system of the thesis' section 6.5.
 * The twin of 03_modules.py, which prints the same. */

#include <glapp.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const double H = 0.1; /* time between two scans [s] */
static glapp_graph *loop = NULL;

/* Ends the program with what went wrong. */
static void must(int32_t code) {
    if (code < 0) {
        fprintf(stderr, "%s\n", glapp_error());
        exit(1);
    }
}

static double get(const char *path) {
    double value = 0.0;
    must(glapp_graph_get(loop, path, &value));
    return value;
}

static void set(const char *path, double value) { must(glapp_graph_set(loop, path, value)); }

/* So many seconds, scan by scan. */
static void run(double seconds) {
    int left;
    for (left = (int)(seconds / H + 0.5); left > 0; left--) must(glapp_graph_scan(loop, H));
}

/* What the controller has detected so far. */
static void show(const char *what) {
    printf("%s: %.0f detections, estimate %.2f %%\n", what, get("pid.detections"), get("pid.d_hat"));
}

int main(void) {
    const glapp_setting sp[] = {{"value", 50.0}};
    const glapp_setting load[] = {{"value", 5.0}};
    const glapp_setting pid[] = {{"k", 2.0},  {"ti", 2.0},     {"tf", 0.2}, {"low", 0.0},
                                 {"high", 100.0}, {"kp", 1.0}, {"start", 50.0}};
    const glapp_setting gap[] = {{"d", 2.0}};
    const glapp_setting process[] = {{"gain", 1.0}, {"t1", 3.0}, {"t2", 1.0}, {"start", 50.0}};
    const glapp_setting noise[] = {{"amplitude", 0.1}, {"seed", 1.0}};
    const glapp_module modules[] = {
        {"sp", "Input", sp, 1},        {"load", "Input", load, 1},           {"pid", "PidAdvanced", pid, 7},
        {"gap", "Backlash", gap, 1},   {"process", "ProcessSim", process, 4}, {"noise", "Noise", noise, 2},
    };
    const char *const wires[] = {"sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"};
    double before;

    if (glapp_abi() != GLAPP_ABI) {
        fprintf(stderr, "the library has version %u of the interface, the header %d\n", (unsigned)glapp_abi(), GLAPP_ABI);
        return 1;
    }
    must(glapp_graph_new(H, modules, 6, wires, 3, &loop));

    run(1000.0);
    show("a gap of 2 %");

    set("gap.d", 4.0); /* the valve wears */
    run(1000.0);
    show("a gap of 4 %");

    set("pid.mode", 0.0); /* manual */
    before = get("pid.out");
    set("load.value", 10.0);
    run(100.0);
    set("pid.mode", 2.0); /* external */
    must(glapp_graph_scan(loop, H));
    printf("back from manual: the output moved by %.1f %%\n", fabs(get("pid.out") - before));
    show("and nothing was learnt meanwhile");

    must(glapp_graph_free(loop));
    return 0;
}

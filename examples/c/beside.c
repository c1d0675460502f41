/* Detection and compensation beside a controller that is not glapp's: here a PI controller of a few lines.
 *
 * Every scan their system's SP, PV, OP, mode and the u_FF in effect go in, and the u_FF to be added to OP comes out.
 * Valve and process are simulated: a gap of 2 % before a level, under a load that steps. */

#include <glapp.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends the program with what went wrong. */
static void must(int32_t code) {
    if (code < 0) {
        fprintf(stderr, "%s\n", glapp_error());
        exit(1);
    }
}

int main(void) {
    const double k = 0.5, ti = 40.0, h = 1.0, sp = 50.0, d = 2.0;
    const glapp_setting watch[] = {{"k", k},          {"ti", ti},          {"integrating", 1.0}, {"op_low", 0.0},
                                   {"op_high", 100.0}, {"comp_size", 2.0}, {"comp_share", 0.8}, {"comp_watch", 30000.0}};
    const glapp_module modules[] = {{"sp", "Input", NULL, 0},   {"pv", "Input", NULL, 0},   {"flags", "Input", NULL, 0},
                                    {"op", "Input", NULL, 0},   {"u_ff", "Input", NULL, 0}, {"watch", "BacklashDetection", watch, 8},
                                    {"ff", "Output", NULL, 0}};
    const char *const wires[] = {"sp -> watch.sp", "pv -> watch.pv",     "flags -> watch.flags",
                                 "op -> watch.op", "u_ff -> watch.u_ff", "watch -> ff"};
    glapp_graph *beside = NULL;
    double pv = 49.0, valve = 50.0, integral = 50.0, u_ff = 0.0, value = 0.0;
    int scan;

    must(glapp_graph_new(h, modules, 7, wires, 6, &beside));
    for (scan = 0; scan < 6000; scan++) {
        /* Their controller, with u_FF at its feed-forward. */
        const double load = scan / 500 % 2 == 0 ? 0.0 : 0.5, e = sp - pv;
        double op;
        integral = integral + k * h / ti * e;
        op = k * e + integral + u_ff;
        /* The valve stays where it is until OP has gone through the gap. */
        if (op - valve > d / 2.0) valve = op - d / 2.0;
        if (valve - op > d / 2.0) valve = op + d / 2.0;

        must(glapp_graph_set(beside, "sp.value", sp));
        must(glapp_graph_set(beside, "pv.value", pv));
        must(glapp_graph_set(beside, "flags.value", 0.0)); /* in automatic, all well */
        must(glapp_graph_set(beside, "op.value", op));
        must(glapp_graph_set(beside, "u_ff.value", u_ff));
        must(glapp_graph_scan(beside, h));
        must(glapp_graph_get(beside, "ff.value", &u_ff));

        pv = pv + (valve - 50.0 + load) / 10.0 * h;
        if (scan == 2999) {
            must(glapp_graph_get(beside, "watch.d_hat", &value));
            printf("before: estimate %.17g\n", value);
            must(glapp_graph_set(beside, "watch.compensate", 1.0));
        }
        if (scan % 1000 == 999) {
            must(glapp_graph_get(beside, "watch.standing", &value));
            printf("scan %d: PV %.17g, u_FF %.17g, standing %.0f\n", scan + 1, pv, u_ff, value);
        }
    }
    must(glapp_graph_free(beside));
    return 0;
}

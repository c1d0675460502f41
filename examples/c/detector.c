/* The on-line detector: samples in, half-periods and the estimate of the gap out.
 *
 *     detector K TI H < recording.txt
 *
 * K [OP unit/PV unit] and TI [s] are the controller's, H [s] is the usual time between two rows. Each row holds time
 * [s], SP, PV and OP, with spaces between them. */

#include <glapp.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends the program with what went wrong. */
static int32_t must(int32_t code) {
    if (code < 0) {
        fprintf(stderr, "%s\n", glapp_error());
        exit(1);
    }
    return code;
}

int main(int argc, char **argv) {
    glapp_setting settings[3] = {{"k", 0.0}, {"ti", 0.0}, {"h", 0.0}};
    glapp_detector *detector = NULL;
    glapp_half_period ended;
    glapp_estimate estimate;
    double t, sp, pv, op;
    unsigned long rows = 0;
    int k, read;

    if (argc != 4) {
        fprintf(stderr, "detector K TI H < recording.txt\n");
        return 2;
    }
    for (k = 0; k < 3; k++) settings[k].value = atof(argv[k + 1]);
    must(glapp_detector_new(settings, 3, &detector));
    while ((read = scanf("%lf %lf %lf %lf", &t, &sp, &pv, &op)) == 4) {
        if (must(glapp_detector_update(detector, t, sp, pv, &op, 0, &ended)) == GLAPP_YES)
            printf("%.17g s to %.17g s: d = %.17g, reason %u\n", ended.t_start, ended.t_end, ended.d, (unsigned)ended.reason);
        rows++;
    }
    if (read != EOF) {
        fprintf(stderr, "after row %lu: four numbers are needed\n", rows);
        return 1;
    }
    if (must(glapp_detector_estimate(detector, &estimate)) == GLAPP_YES)
        printf("estimate %.17g from %u detections\n", estimate.value, (unsigned)estimate.count);
    must(glapp_detector_free(detector));
    return 0;
}

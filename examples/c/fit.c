/* The fit: width of the gap with its 95 % interval, from a recording.
 *
 *     fit SIGN < recording.txt
 *
 * SIGN is that of the process gain: 1, -1, or 0 where it is not known. Each row holds time [s], SP, PV and OP, with
 * spaces between them. */

#include <glapp.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    enum { MOST = 100000 };
    double *t = (double *)malloc(4 * MOST * sizeof(double));
    double *sp = t + MOST, *pv = sp + MOST, *op = pv + MOST;
    glapp_columns columns = {0, t, sp, pv, op, NULL, NULL};
    glapp_width width;
    size_t n = 0;
    int read = EOF;

    if (argc != 2 || t == NULL) {
        fprintf(stderr, "fit SIGN < recording.txt\n");
        return 2;
    }
    while (n < MOST && (read = scanf("%lf %lf %lf %lf", &t[n], &sp[n], &pv[n], &op[n])) == 4) n++;
    /* A part of a recording would be another recording. */
    if (read != EOF) {
        fprintf(stderr, n == MOST ? "%lu rows or more: too many for this example\n" : "after row %lu: four numbers are needed\n", (unsigned long)n);
        free(t);
        return 1;
    }
    columns.rows = n;
    if (glapp_fit(&columns, atof(argv[1]), &width) < 0) {
        fprintf(stderr, "%s\n", glapp_error());
        return 1;
    }
    printf("width %.17g (%.17g to %.17g), verdict %u, %s\n", width.d, width.low, width.high, (unsigned)width.verdict, width.why);
    printf("process: gain %.17g, dead time %.17g s, lag %.17g s\n", width.kp, width.dead_time, width.lag);
    free(t);
    return 0;
}

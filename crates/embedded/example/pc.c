/* The loop on a PC. */

#include <stdio.h>

void print(const char *text) {
    fputs(text, stdout);
}

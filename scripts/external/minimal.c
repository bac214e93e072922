/* A refiner in plain C, without any library: the point where image gradients about a corner are orthogonal to the way
 * to it (Foerstner and Guelch 1987), in a window of 11 x 11 pixels, moved to the answer up to 40 times.
 *
 *     cc -O2 -o minimal_c minimal.c -lm && cornerbench measure PLAN --with ./minimal_c
 *
 * What is said is described in scripts/PROTOCOL.md. A question is one line of JSON; what this needs of it stands behind
 * known keys, so that strstr and strtod read it. Printing to standard output is the protocol's alone: say the rest on
 * standard error. */

#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { HALF_WINDOW_PX = 5, MOST_ITERATIONS = 40 };

static double now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e6 * (double)now.tv_sec + 1e-3 * (double)now.tv_nsec;
}

/* What stands behind a key; NULL where it is not there. */
static const char *behind(const char *line, const char *key) {
    const char *found = strstr(line, key);
    return found ? found + strlen(key) : NULL;
}

static long number(const char *line, const char *key) {
    const char *found = behind(line, key);
    return found ? strtol(found, NULL, 10) : 0;
}

/* The grey value between pixels, in between linear; the centre of the top-left pixel is (0, 0). */
static double sample(const unsigned char *image, long width, long height, double x, double y) {
    if (x < 0.0) x = 0.0;
    if (y < 0.0) y = 0.0;
    if (x > width - 1.001) x = width - 1.001;
    if (y > height - 1.001) y = height - 1.001;
    long left = (long)x, top = (long)y;
    double right = x - left, down = y - top;
    const unsigned char *at = image + top * width + left;
    return (1 - down) * ((1 - right) * at[0] + right * at[1]) + down * ((1 - right) * at[width] + right * at[width + 1]);
}

/* Moves a point; whether it came to rest near where it began. */
static int refine(const unsigned char *image, long width, long height, double *x, double *y) {
    double from_x = *x, from_y = *y;
    for (int iteration = 0; iteration < MOST_ITERATIONS; ++iteration) {
        double xx = 0, xy = 0, yy = 0, bx = 0, by = 0;
        for (int down = -HALF_WINDOW_PX; down <= HALF_WINDOW_PX; ++down) {
            for (int right = -HALF_WINDOW_PX; right <= HALF_WINDOW_PX; ++right) {
                double px = *x + right, py = *y + down;
                double gx = sample(image, width, height, px + 1, py) - sample(image, width, height, px - 1, py);
                double gy = sample(image, width, height, px, py + 1) - sample(image, width, height, px, py - 1);
                double weight = exp(-(right * right + down * down) / (double)(HALF_WINDOW_PX * HALF_WINDOW_PX));
                xx += weight * gx * gx, xy += weight * gx * gy, yy += weight * gy * gy;
                bx += weight * (gx * gx * right + gx * gy * down);
                by += weight * (gx * gy * right + gy * gy * down);
            }
        }
        double determinant = xx * yy - xy * xy;
        if (!(determinant > 1e-6 * (xx + yy) * (xx + yy))) return 0;
        double dx = (yy * bx - xy * by) / determinant, dy = (xx * by - xy * bx) / determinant;
        *x += dx, *y += dy;
        if (fabs(*x - from_x) > HALF_WINDOW_PX || fabs(*y - from_y) > HALF_WINDOW_PX) return 0;
        if (dx * dx + dy * dy < 1e-6) return 1;
    }
    return 1;
}

int main(void) {
    char *line = NULL;
    size_t room = 0;
    const unsigned char *image = NULL;
    long mapped = 0;
    if (getline(&line, &room, stdin) < 0) return 0;
    printf("{\"protocol\": 1, \"version\": \"1\", \"does\": [\"refine\"]}\n");
    fflush(stdout);
    while (getline(&line, &room, stdin) > 0) {
        long id = number(line, "\"id\":"), width = number(line, "\"width\":"), height = number(line, "\"height\":");
        const char *file = behind(line, "\"file\":\""), *seeds = behind(line, "\"seeds\":[");
        if (!file || !seeds) {
            printf("{\"id\": %ld, \"error\": \"there is no image, or nothing to refine\"}\n", id);
            fflush(stdout);
            continue;
        }
        /* The file is always the same one, and may only grow. */
        if (width * height > mapped) {
            char path[4096];
            snprintf(path, sizeof path, "%.*s", (int)strcspn(file, "\""), file);
            int handle = open(path, O_RDONLY);
            void *bytes = handle < 0 ? MAP_FAILED : mmap(NULL, (size_t)(width * height), PROT_READ, MAP_SHARED, handle, 0);
            if (bytes == MAP_FAILED) {
                perror(path);
                return 1;
            }
            close(handle);
            if (image) munmap((void *)image, (size_t)mapped);
            image = bytes, mapped = width * height;
        }
        /* The answer is printed as it is found; only the search for corners is timed. */
        double took_us = 0.0;
        printf("{\"id\": %ld, \"points\": [", id);
        const char *between = "";
        while (*seeds == '[' || *seeds == ',') {
            seeds += *seeds == ',' ? 2 : 1;
            char *end;
            double x = strtod(seeds, &end), y = strtod(end + 1, &end);
            seeds = end + 1;
            double begun_us = now_us();
            int is_corner = width > 1 && height > 1 && refine(image, width, height, &x, &y);
            took_us += now_us() - begun_us;
            if (is_corner) {
                printf("%s[%.17g, %.17g]", between, x, y);
            } else {
                printf("%snull", between);
            }
            between = ", ";
        }
        printf("], \"took_us\": %.3f}\n", took_us);
        fflush(stdout);
    }
    return 0;
}

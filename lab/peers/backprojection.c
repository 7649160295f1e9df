/* Dense backprojection in plain C, as a careful programmer writes it and the compiler vectorises it: the peer of `lab benchmark --peers`.

       cc -O3 -ffast-math -march=... backprojection.c -o peer -lm && ./peer DATA ls|coherent OUT

   DATA: a header, then the positions of the sweeps (x, y, z) and their range-compressed samples (all real parts, all imaginary
   parts), as 32-bit floats. OUT: the volume, x fastest, as floats. Prints the seconds of the fastest of many repetitions.
   `ls` is the sum of |z|^2, linear between samples of |z|^2; `coherent` is |sum of z e^(-jkd)|, linear between samples of z.
   Every distance lies within the sampled ranges, so there are no checks. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

struct header {
    uint32_t voxels, sweeps, points;
    float first_m, step_m, phase_rad_per_m, origin_m[3], voxel_m;
};

static struct header h;
static float *px, *py, *pz, *re, *im, *power, *difference, *out;

/* Single precision is enough for a phase of some hundred turns: whole turns are taken off first, then series to 1e-7. */
#define TURNS_TO_SIN(x, x2) ((x) * (6.2831853f + (x2) * (-41.341702f + (x2) * (81.605249f + (x2) * (-76.705859f + (x2) * 42.0f)))))
#define TURNS_TO_COS(x2) (1.0f + (x2) * (-19.739209f + (x2) * (64.939394f + (x2) * (-85.456817f + (x2) * (60.24464f + (x2) * -26.4f)))))

static void ls(void) {
    const int n = h.voxels;
    float *restrict sum = malloc(n * sizeof *sum);
    const float per_step = 1.0f / h.step_m, first_m = h.first_m, voxel_m = h.voxel_m;
    for (int row = 0; row < n * n; row++) {
        const float y = h.origin_m[1] + (row % n + 0.5f) * h.voxel_m, z = h.origin_m[2] + (row / n + 0.5f) * h.voxel_m;
        memset(sum, 0, n * sizeof *sum);
        for (uint32_t s = 0; s < h.sweeps; s++) {
            const float dy = y - py[s], dz = z - pz[s], across = dy * dy + dz * dz;
            const float x0 = h.origin_m[0] + 0.5f * voxel_m - px[s];
            const float *restrict values = power + (size_t)s * h.points;
            const float *restrict steps = difference + (size_t)s * h.points;
            for (int x = 0; x < n; x++) {
                const float dx = x0 + x * voxel_m;
                const float at = (sqrtf(across + dx * dx) - first_m) * per_step;
                const int before = (int)at;
                sum[x] += values[before] + (at - before) * steps[before];
            }
        }
        memcpy(out + (size_t)row * n, sum, n * sizeof *sum);
    }
    free(sum);
}

static void coherent(void) {
    const int n = h.voxels;
    const float per_step = 1.0f / h.step_m, turns_per_m = h.phase_rad_per_m / 6.2831853f;
    float *sum_re = malloc(n * sizeof *sum_re), *sum_im = malloc(n * sizeof *sum_im);
    for (int row = 0; row < n * n; row++) {
        const float y = h.origin_m[1] + (row % n + 0.5f) * h.voxel_m, z = h.origin_m[2] + (row / n + 0.5f) * h.voxel_m;
        memset(sum_re, 0, n * sizeof *sum_re);
        memset(sum_im, 0, n * sizeof *sum_im);
        for (uint32_t s = 0; s < h.sweeps; s++) {
            const float dy = y - py[s], dz = z - pz[s], across = dy * dy + dz * dz;
            const float x0 = h.origin_m[0] + 0.5f * h.voxel_m - px[s];
            const float *a = re + (size_t)s * h.points, *b = im + (size_t)s * h.points;
            for (int x = 0; x < n; x++) {
                const float dx = x0 + x * h.voxel_m, distance = sqrtf(across + dx * dx);
                const float at = (distance - h.first_m) * per_step;
                const int before = (int)at;
                const float share = at - before;
                const float zr = a[before] + share * (a[before + 1] - a[before]);
                const float zi = b[before] + share * (b[before + 1] - b[before]);
                float turns = distance * turns_per_m;
                turns -= nearbyintf(turns);
                /* Folded into a quarter turn, where the series hold. */
                const float size = fabsf(turns), folded = size > 0.25f ? 0.5f - size : size, squared = folded * folded;
                float sine = TURNS_TO_SIN(folded, squared), cosine = TURNS_TO_COS(squared);
                sine = turns < 0 ? -sine : sine;
                cosine = size > 0.25f ? -cosine : cosine;
                sum_re[x] += zr * cosine + zi * sine;
                sum_im[x] += zi * cosine - zr * sine;
            }
        }
        for (int x = 0; x < n; x++) out[(size_t)row * n + x] = sqrtf(sum_re[x] * sum_re[x] + sum_im[x] * sum_im[x]);
    }
    free(sum_re);
    free(sum_im);
}

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static float *floats(size_t count, FILE *from) {
    /* One more, for the sample after the last. */
    float *values = calloc(count + 1, sizeof *values);
    if (!values || (from && fread(values, sizeof *values, count, from) != count)) {
        fputs("peer: the data end too early\n", stderr);
        exit(1);
    }
    return values;
}

int main(int count, char **words) {
    FILE *data = count == 4 ? fopen(words[1], "rb") : NULL;
    if (!data || fread(&h, sizeof h, 1, data) != 1) {
        fputs("peer: usage: peer DATA ls|coherent OUT\n", stderr);
        return 1;
    }
    const size_t samples = (size_t)h.sweeps * h.points, voxels = (size_t)h.voxels * h.voxels * h.voxels;
    float *positions = floats(3 * (size_t)h.sweeps, data);
    px = floats(h.sweeps, NULL), py = floats(h.sweeps, NULL), pz = floats(h.sweeps, NULL);
    for (uint32_t s = 0; s < h.sweeps; s++) px[s] = positions[3 * s], py[s] = positions[3 * s + 1], pz[s] = positions[3 * s + 2];
    re = floats(samples, data), im = floats(samples, data);
    power = floats(samples, NULL), difference = floats(samples, NULL), out = floats(voxels, NULL);
    for (size_t n = 0; n < samples; n++) power[n] = re[n] * re[n] + im[n] * im[n];
    for (size_t n = 0; n + 1 < samples; n++) difference[n] = power[n + 1] - power[n];

    void (*sums)(void) = strcmp(words[2], "ls") == 0 ? ls : coherent;
    double best_s = 1e9, begin_s = now_s();
    do {
        const double start_s = now_s();
        sums();
        const double took_s = now_s() - start_s;
        if (took_s < best_s) best_s = took_s;
    } while (now_s() - begin_s < 2.0);
    printf("%.9f\n", best_s);

    FILE *volume = fopen(words[3], "wb");
    return !volume || fwrite(out, sizeof *out, voxels, volume) != voxels || fclose(volume) != 0;
}

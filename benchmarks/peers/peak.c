/* Peak additions and multiplications per second of one core, with ten independent vectors.
   gcc -O3 -march=native -ffp-contract=off peak.c -o peak && ./peak */
#include <stdio.h>
#include <time.h>
#ifdef __AVX512F__
#define BYTES 64
#elif defined(__AVX__)
#define BYTES 32
#else
#define BYTES 16
#endif
typedef double vector __attribute__((vector_size(BYTES)));
#define EACH(F) F(a) F(b) F(c) F(d) F(e) F(f) F(g) F(h) F(i) F(j)
#define DECLARE(v) vector v = {0.1};
#define STEP(v) v = v * factor + addend; __asm__ volatile("" : "+v"(v));

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(void) {
    const long sweeps = 10 * 1000 * 1000;
    vector factor = {0.5}, addend = {0.25};
    EACH(DECLARE)
    double shortest = 1e9;
    for (int repetition = 0; repetition < 9; repetition++) {
        double start = now();
        for (long k = 0; k < sweeps; k++) { EACH(STEP) }
        double time = now() - start;
        if (time < shortest) shortest = time;
    }
    printf("%.2f GFLOP/s\n", sweeps * 10.0 * 2 * (BYTES / 8) / shortest / 1e9);
    return 0;
}

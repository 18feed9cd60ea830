/* The wall clock of a machine whose battery is flat: read after read it jumps by hours, back and forth.
   Loaded before the C library (LD_PRELOAD), and still until RAUCA_CLOCK is set. Clocks that only run are left alone. */
#define _GNU_SOURCE
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static long jump(void) {
    static unsigned long reads;
    if (!getenv("RAUCA_CLOCK")) return 0;
    unsigned long read = __atomic_fetch_add(&reads, 1, __ATOMIC_RELAXED);
    return 3600 * (long)(read % 20000) * ((read & 4) ? 1 : -1);
}

int clock_gettime(clockid_t which, struct timespec *now) {
    int failed = syscall(SYS_clock_gettime, which, now);
    if (!failed && (which == CLOCK_REALTIME || which == CLOCK_REALTIME_COARSE)) now->tv_sec += jump();
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec exact;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *place) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (place) *place = now.tv_sec;
    return now.tv_sec;
}

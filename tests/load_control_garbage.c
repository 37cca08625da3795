/* Steps of the C controller under random settings and inputs: counts outputs outside of their limits.
 *
 *     garbage STEPS SEED    prints: loops that started, steps, outputs outside, faults, overloads, worn
 */
#include <stdio.h>
#include <stdlib.h>
#include "controller.c"

static unsigned long word = 1;

static unsigned long drawn(void) /* xorshift of 32 bits */
{
    word ^= (word << 13) & 0xffffffffUL;
    word ^= word >> 17;
    word ^= (word << 5) & 0xffffffffUL;
    return word & 0xffffffffUL;
}

static double uniform(double low, double high) { return low + (high - low) * (double)drawn() / 4294967295.0; }

static double odd(double usual) /* a usual value, or one that nobody expects */
{
    static const double strange[] = {0.0, -0.0, -1.0, 1e-320, -1e-320, 1e-30, 1e30, -1e30, 1e300, -1e300, 0.5, 1.0};
    const double zero = usual - usual;
    const unsigned long kind = drawn() % 64;
    if (kind == 0) return zero / zero;
    if (kind == 1) return 1.0 / zero;
    if (kind == 2) return -1.0 / zero;
    if (kind < 15) return strange[kind - 3];
    return kind == 15 ? usual * uniform(-3.0, 3.0) : usual;
}

static LoadSettings settings(int garbage)
{
    LoadSettings s = load_settings;
    LoadReal *field = &s.sample_time, *of_law = &s.approach;
    int k;
    if (!garbage) return s;
    for (k = 0; k < 23; ++k)
        if (drawn() % 8 == 0) field[k] = (LoadReal)odd((double)field[k] * uniform(0.2, 5.0));
    for (k = 0; k < 16; ++k)
        if (drawn() % 32 == 0) of_law[k] = (LoadReal)odd((double)of_law[k] * uniform(0.2, 5.0));
    s.average = 1 + (int)(drawn() % (unsigned long)LOAD_CONTROL_AVERAGE);
    s.average_command = (int)(drawn() % 2);
    s.incremental = (int)(drawn() % 2);
    s.stop_on_fault = (int)(drawn() % 2);
    return s;
}

static int outside(const LoadSettings *s, const LoadInput *in, const LoadOutput *out)
{
    const double exact = 1.0 + (sizeof(LoadReal) == sizeof(float) ? 1e-5 : 1e-12);
    const double real = (double)out->feed_override * (double)in->requested;
    if (!(out->u >= s->low && out->u <= s->high)) return 1;
    if (!(out->feed_override > 0 && out->feed_override <= (LoadReal)1)) return 2;
    if (in->requested > 0 && in->requested < (LoadReal)1e29 && !(real <= (double)s->high * (double)s->feed_programmed * exact))
        return 3;
    if (!((int)out->state >= 0 && (int)out->state <= 5)) return 4;
    if (out->state == LOAD_FAULT && !(out->feed_override <= out->u)) return 6;
    if ((out->fault | out->worn | out->overload | out->feed_inhibit) & ~1) return 5;
    return 0;
}

int main(int count, char **words)
{
    const long steps = count > 1 ? atol(words[1]) : 100000L;
    static LoadState state;
    long k = 0, loops = 0, wrong = 0, fault = 0, worn = 0, overload = 0;
    word = count > 2 ? strtoul(words[2], NULL, 10) | 1UL : 1UL;
    while (k < steps) {
        const LoadSettings s = settings(loops % 3 != 0);
        const long length = 500 + (long)(drawn() % 2000);
        long last;
        double level = 0.8 * (double)load_settings.reference;
        LoadInput in;
        LoadOutput out;
        int started;
        memset(&in, 0, sizeof in);
        started = load_control_init(&s, &state) == 0;
        last = k + (started ? length : 1);
        ++loops;
        for (; k < last && k < steps; ++k) {
            const unsigned long bits = drawn();
            if (bits % 200 == 0) level = uniform(0.15, 2.0) * (double)load_settings.reference;
            in.period = (LoadReal)(bits % 977 == 0 ? odd((double)s.sample_time) : (double)s.sample_time);
            in.load = (LoadReal)(bits % 16 == 0 ? odd(level) : level * uniform(0.95, 1.05));
            in.requested = (LoadReal)(bits % 31 == 0 ? odd((double)s.feed_programmed) : (double)s.feed_programmed);
            in.enable = bits % 499 == 0 ? (int)bits : (bits >> 9) % 400 != 0;
            in.spindle_on = (bits >> 10) % 400 != 0;
            in.idle = (bits >> 11) % 5 == 0;
            in.slowed = (bits >> 14) % 10 == 0;
            in.beat = (bits >> 12) % 3 == 0;
            in.reset = (bits >> 13) % 50 == 0;
            load_control_step(&s, &state, &in, &out);
            if (!started) {
                wrong += out.feed_override > 0 || !out.feed_inhibit || out.state != LOAD_FAULT;
                continue;
            }
            wrong += outside(&s, &in, &out) != 0;
            fault += out.fault;
            worn += out.worn;
            overload += out.overload;
        }
    }
    printf("%ld %ld %ld %ld %ld %ld\n", loops, k, wrong, fault, worn, overload);
    return wrong != 0;
}

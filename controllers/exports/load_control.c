/* Control of a load or force by feed override: one step function for firmware, LinuxCNC (halcompile) and FMI co-simulation.
 *
 * C90, no allocation, no global state, one call per period. Use:
 *
 *     static LoadState state;
 *     LoadInput input; LoadOutput output;
 *     if (load_control_init(&load_settings, &state) != 0) stop();
 *     every sample_time seconds:  fill input;  load_control_step(&load_settings, &state, &input, &output);
 *
 * In a second file, #define LOAD_CONTROL_DECLARATIONS_ONLY before including this one. For single precision compile
 * every file with -DLOAD_CONTROL_REAL=float. Do not compile with -ffast-math: it removes the tests for NaN.
 * One supervision (states, faults, overload, worn) around one of three laws: PI on the load, feed in proportion to
 * reference over measured force, or the adaptive law on the force averaged over a revolution.
 * A state that load_control_init did not accept stops the feed: override 0, feed_inhibit 1, state LOAD_FAULT.
 */
#ifndef LOAD_CONTROL_DECLARATIONS
#define LOAD_CONTROL_DECLARATIONS

#ifdef __FAST_MATH__
#error "load_control needs NaN: compile without -ffast-math"
#endif
#ifndef LOAD_CONTROL_REAL
#define LOAD_CONTROL_REAL double
#endif
#ifndef LOAD_CONTROL_AVERAGE
#define LOAD_CONTROL_AVERAGE 1 /* longest moving average, in samples */
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef LOAD_CONTROL_REAL LoadReal;

typedef enum { LOAD_OFF, LOAD_AIR, LOAD_ENTRY, LOAD_CONTROL, LOAD_WORN, LOAD_FAULT } LoadStateName;

typedef enum {
    LOAD_NO_CAUSE,
    LOAD_LOST,              /* readings invalid (NaN, infinite, outside load_low to load_high) for lost_after, or more
                               than a fifth of them over some 5 lost_after */
    LOAD_STUCK,             /* equal readings in the cut for stuck_after */
    LOAD_NO_HEARTBEAT,      /* beat did not change for heartbeat */
    LOAD_REQUESTED_INVALID, /* requested feed is NaN, infinite or negative */
    LOAD_PERIOD_WRONG       /* the period is more than 1 % off sample_time */
} LoadCause;

typedef enum { LOAD_PI, LOAD_RATIO, LOAD_ADAPTIVE } LoadLaw;

typedef struct {          /* load: in the unit of the load; override: feed / feed_programmed */
    LoadReal sample_time; /* s: period of the calls */
    LoadReal reference;   /* load that the loop holds */
    LoadReal low;         /* smallest override, above 0 */
    LoadReal high;        /* largest override, at most 1 */
    LoadReal feed_programmed; /* unit of LoadInput.requested: feed at which the override is 1 */
    LoadReal p;               /* override per load; incremental: each sample */
    LoadReal i;               /* override per load and s */
    LoadReal entry_gain;      /* override per load: step of the feed at entry per error */
    LoadReal filter_time;     /* s: time constant of the low-pass on the load, 0 none */
    LoadReal engage_at;       /* load: middle of the threshold of a cut */
    LoadReal hysteresis;      /* load: whole width of the threshold */
    LoadReal engage_after;    /* s above the threshold until the loop closes */
    LoadReal arm_after;       /* s of spindle_on until armed */
    LoadReal lost_after;      /* s of invalid readings until fault */
    LoadReal stuck_after;     /* s of one reading in the cut until fault, 0 not monitored */
    LoadReal heartbeat;       /* s without a change of beat until fault, 0 not monitored */
    LoadReal overload_after;  /* s of a mean load above 1.05 worn_load until overload */
    LoadReal dwell;           /* s at the lower limit in the cut until worn */
    LoadReal worn_load;       /* load that a worn tool withstands */
    LoadReal back_off;        /* override per s: fastest fall */
    LoadReal recover;         /* override per s: fastest rise */
    LoadReal load_low;        /* load at or below which a reading is invalid, with the PI above 0 */
    LoadReal load_high;       /* load at or above which a reading is invalid */
    int average;              /* samples of the moving average, 1 none */
    int average_command;      /* 1: average of the command, 0: of the load */
    int incremental;          /* 1: u = last u + p e + i T sum(e), 0: position form */
    int stop_on_fault;        /* 1: a fault sets feed_inhibit, 0: the feed goes to the lower limit */
    int law;                  /* LoadLaw; the settings that follow are those of LOAD_RATIO and LOAD_ADAPTIVE */
    LoadReal approach;        /* override in air, low to high: reached from known air, never exceeded there */
    LoadReal servo_time;      /* s, LOAD_RATIO: time constant of the feed drive */
    LoadReal m;               /* LOAD_ADAPTIVE: first estimate of the process, feed s^2 per load */
    LoadReal alpha;           /* the same, feed s per load */
    LoadReal beta;            /* the same, feed per load */
    LoadReal g1;              /* rates of adaptation of m, alpha, beta; 0 keeps one of them */
    LoadReal g2;
    LoadReal g3;
    LoadReal Kd;              /* feed s per load: gain */
    LoadReal lam;             /* 1/s */
    LoadReal model_time;      /* s: reference model of second order, its damping, and its transition over sample_time */
    LoadReal model_damping;
    LoadReal model_a;
    LoadReal model_b;
    LoadReal model_c;
    LoadReal model_d;
} LoadSettings;

typedef struct {
    LoadReal period;    /* s since the last call, measured; more than 1 % off sample_time is a fault */
    LoadReal load;      /* reading of the sensor; any value, also NaN */
    LoadReal requested; /* feed that the program requests before this override, times an override of the operator
                           above 1; 0 at rest. One below 1 is not part of it: see slowed. Where unknown:
                           feed_programmed, and the limits hold only for a program with that F at 100 %.
                           In a wrong unit it lets the override rise up to 1, except in a fault */
    int enable;         /* the operator's switch */
    int spindle_on;     /* spindle at speed */
    int idle;           /* the path does not advance: at rest, in a pause, at an override of 0 */
    int slowed;         /* the operator's override is below 1, or the path is more than 5 % slower than commanded, as in
                           a corner: the override does not rise; 1 where it is not known */
    int beat;           /* 0 or 1, changes while the source of the load is alive; of a counter: counter & 1 */
    int reset;          /* a change from 0 to 1 clears fault, worn and overload unless their cause is present */
} LoadInput;

typedef struct {
    LoadReal feed_override; /* above 0, at most 1; 0 only if not initialised */
    LoadReal u;          /* override before the correction by requested, low to high */
    LoadReal measured;   /* filtered load */
    LoadStateName state;
    LoadCause cause;  /* of the fault, the first one */
    int fault;        /* latched: see cause */
    int worn;         /* latched: change the tool */
    int overload;     /* latched: mean load above what a worn tool withstands */
    int feed_inhibit; /* stop the feed */
} LoadOutput;

typedef struct {
    LoadReal gain, overload_gain, worn_gain, half_hysteresis, middle, half, fall, rise, rest, overload_above;
    long n_slow, n_arm, n_engage, n_lost, n_stuck, n_beat, n_overload, n_dwell;
    LoadReal held, filtered, measured, mean, u, before, base, bias, sum, average, factor;
    LoadReal kept[LOAD_CONTROL_AVERAGE];
    LoadReal servo, servo_gain;                                         /* of LOAD_RATIO */
    LoadReal m, alpha, beta, wanted, wanted_rate, error, last_E, last_w[3]; /* of LOAD_ADAPTIVE */
    LoadReal forces[LOAD_CONTROL_AVERAGE + 1], model[LOAD_CONTROL_AVERAGE + 1], rates[LOAD_CONTROL_AVERAGE + 1];
    LoadReal force_sum, model_sum;
    long spindle, bad, gap, gaps, sparse, loaded_for, clear_for, same, alive, high_for, rested, slow;
    int ready, begun, armed, place, over, above, cutting, clipped, falling, had_cut, last_beat, last_reset, ring, soft;
    int fault, worn, overload, capped;
    LoadCause cause;
} LoadState;

/* 0, or the number of the first setting (1: sample_time) that is out of range. */
int load_control_init(const LoadSettings *s, LoadState *x);
void load_control_step(const LoadSettings *s, LoadState *x, const LoadInput *in, LoadOutput *out);

#ifdef __cplusplus
}
#endif
#endif

#ifndef LOAD_CONTROL_DECLARATIONS_ONLY
#include <string.h>

#define LOAD_OVERLOAD_SHARE 1.05 /* of worn_load */
#define LOAD_OVERLOAD_MEAN 0.1   /* s: a one-pole mean that lags as a mean over .2 s */
#define LOAD_REST_SHARE 0.01     /* of high - low, at most of low: an override so near low rests on it */
#define LOAD_WORN_MEAN 0.2       /* s */
#define LOAD_SLOW_AFTER 0.5      /* s after a feed that was slowed: the load has followed it */
#define LOAD_PERIOD_SHARE 0.01   /* of sample_time */
#define LOAD_LONGEST 2000000000L /* samples: counters stop there */
#define LOAD_SPARSE_RISE 4L      /* an invalid reading adds it, a valid one takes 1: more than a fifth of them rises */
#define LOAD_SPARSE_AT 8L        /* times the samples of lost_after: lost */
#define LOAD_SPARSE_MOST 10L     /* the same: the count stops there */
#define LOAD_MOST 1e30           /* a feed at or above is infinite */
#define LOAD_READY 0x4c43        /* LoadState.ready after load_control_init */

static int load_between(LoadReal low, LoadReal x, LoadReal high) { return low < x && x < high; } /* NaN: 0 */

static LoadReal load_clip(LoadReal x, LoadReal low, LoadReal high) /* NaN: low */
{
    if (!(x >= low)) x = low;
    return x > high ? high : x;
}

static long load_count(long count) { return count < LOAD_LONGEST ? count + 1 : count; }

static long load_samples(LoadReal time, LoadReal sample_time) /* a half rounds to even; 0: out of range */
{
    const double x = (double)time / (double)sample_time;
    double rest;
    long whole;
    if (!(x >= 0.0 && x < (double)LOAD_LONGEST)) return 0;
    whole = (long)x;
    rest = x - (double)whole;
    if (rest > 0.5 || (rest == 0.5 && whole % 2 != 0)) ++whole;
    return whole < 1 ? 1 : whole;
}

static LoadReal load_pole(LoadReal sample_time, double time) /* 1 - exp(-sample_time / time); time 0: 1 */
{
    double x, term, out = 0.0;
    int k, halved = 0;
    if (!(time > 0.0)) return (LoadReal)1;
    x = (double)sample_time / time;
    if (!(x < 40.0)) return (LoadReal)1;
    for (; x > 0.25; x /= 2.0) ++halved;
    for (term = x, k = 2; k < 16; ++k) { /* x - x^2/2! + ... to 1e-19 */
        out += term;
        term *= -x / (double)k;
    }
    for (; halved > 0; --halved) out *= 2.0 - out; /* 1 - exp(-2 x) = (1 - exp(-x)) (1 + exp(-x)) */
    return (LoadReal)out;
}

static int load_first_wrong(const LoadSettings *s)
{
    const LoadReal most = (LoadReal)LOAD_MOST, half = s->hysteresis / (LoadReal)2;
    if (!load_between(0, s->sample_time, most)) return 1;
    if (!load_between(0, s->reference, s->load_high)) return 2;
    if (!load_between(0, s->low, s->high)) return 3;
    if (!(s->high <= (LoadReal)1)) return 4;
    if (!load_between(0, s->feed_programmed, most)) return 5;
    if (!load_between(-most, s->p, most)) return 6;
    if (!load_between(-most, s->i, most)) return 7;
    if (!load_between(-most, s->entry_gain, most)) return 8;
    if (!(s->filter_time >= 0 && s->filter_time < most)) return 9;
    if (!load_between(half, s->engage_at, s->reference - half)) return 10;
    if (!(s->hysteresis >= 0)) return 11;
    if (!load_between(0, s->worn_load, most)) return 19;
    if (!load_between(0, s->back_off, most)) return 20;
    if (!load_between(0, s->recover, most)) return 21;
    if (!(s->law == LOAD_PI ? s->load_low > 0 : s->load_low > -most)) return 22;
    if (!load_between(s->load_low, s->load_high, most)) return 23;
    if (s->average < 1 || s->average > LOAD_CONTROL_AVERAGE) return 24;
    return 0;
}

static int load_first_wrong_of_adaptive(const LoadSettings *s)
{
    const LoadReal most = (LoadReal)LOAD_MOST;
    if (!load_between(-most, s->m, most)) return 31;
    if (!load_between(-most, s->alpha, most)) return 32;
    if (!load_between(-most, s->beta, most)) return 33;
    if (!(s->g1 >= 0 && s->g1 < most)) return 34;
    if (!(s->g2 >= 0 && s->g2 < most)) return 35;
    if (!(s->g3 >= 0 && s->g3 < most)) return 36;
    if (!load_between(0, s->Kd, most)) return 37;
    if (!load_between(0, s->lam, most)) return 38;
    if (!load_between(0, s->model_time, most)) return 39;
    if (!load_between(0, s->model_damping, most)) return 40;
    if (!load_between(-most, s->model_a, most)) return 41;
    if (!load_between(-most, s->model_b, most)) return 42;
    if (!load_between(-most, s->model_c, most)) return 43;
    return load_between(-most, s->model_d, most) ? 0 : 44;
}

static int load_first_wrong_of_law(const LoadSettings *s)
{
    const LoadReal most = (LoadReal)LOAD_MOST;
    if (s->law == LOAD_PI) return 0;
    if (s->law != LOAD_RATIO && s->law != LOAD_ADAPTIVE) return 28;
    if (!(s->approach >= s->low && s->approach <= s->high)) return 29;
    if (!(s->servo_time >= 0 && s->servo_time < most)) return 30;
    return s->law == LOAD_RATIO ? 0 : load_first_wrong_of_adaptive(s);
}

static int load_count_samples(const LoadSettings *s, LoadState *x)
{
    const LoadReal T = s->sample_time;
    x->n_slow = load_samples((LoadReal)LOAD_SLOW_AFTER, T);
    x->n_engage = load_samples(s->engage_after, T);
    x->n_arm = load_samples(s->arm_after, T);
    x->n_lost = load_samples(s->lost_after, T);
    x->n_stuck = load_samples(s->stuck_after, T);
    x->n_beat = load_samples(s->heartbeat, T);
    x->n_overload = load_samples(s->overload_after, T);
    x->n_dwell = load_samples(s->dwell, T);
    if (x->n_slow == 0) return 1;
    if (x->n_engage == 0) return 12;
    if (x->n_arm == 0) return 13;
    if (x->n_lost == 0 || x->n_lost > LOAD_LONGEST / (2L * LOAD_SPARSE_MOST)) return 14;
    if (x->n_stuck == 0) return 15;
    if (x->n_beat == 0) return 16;
    if (x->n_overload == 0) return 17;
    return x->n_dwell == 0 ? 18 : 0;
}

int load_control_init(const LoadSettings *s, LoadState *x)
{
    const LoadReal span = s->high - s->low;
    int wrong = load_first_wrong(s);
    memset(x, 0, sizeof *x);
    if (wrong == 0) wrong = load_first_wrong_of_law(s);
    if (wrong == 0) wrong = load_count_samples(s, x);
    if (wrong != 0) return wrong;
    x->gain = load_pole(s->sample_time, (double)s->filter_time);
    x->overload_gain = load_pole(s->sample_time, LOAD_OVERLOAD_MEAN);
    x->worn_gain = load_pole(s->sample_time, LOAD_WORN_MEAN);
    x->overload_above = (LoadReal)LOAD_OVERLOAD_SHARE * s->worn_load;
    x->half_hysteresis = s->hysteresis / (LoadReal)2;
    x->middle = (s->low + s->high) / (LoadReal)2;
    x->half = (s->high - s->low) / (LoadReal)2;
    x->rest = s->low + (LoadReal)LOAD_REST_SHARE * (span < s->low ? span : s->low);
    x->fall = s->back_off * s->sample_time;
    x->rise = s->recover * s->sample_time;
    x->u = x->servo = s->low;
    x->servo_gain = load_pole(s->sample_time, (double)s->servo_time);
    x->m = s->m;
    x->alpha = s->alpha;
    x->beta = s->beta;
    x->factor = (LoadReal)1;
    x->ready = LOAD_READY;
    return 0;
}

/* The mean of the last values, the oldest first, with this one for the oldest. */
static LoadReal load_average(const LoadSettings *s, LoadState *x, LoadReal value)
{
    LoadReal sum = 0;
    int k;
    x->kept[x->place] = value;
    x->place = x->place + 1 < s->average ? x->place + 1 : 0;
    for (k = x->place; k < s->average; ++k) sum += x->kept[k];
    for (k = 0; k < x->place; ++k) sum += x->kept[k];
    return sum / (LoadReal)s->average;
}

static int load_compare(int was, LoadReal load, LoadReal at, LoadReal half)
{
    const LoadReal over = load - at;
    return over > half ? 1 : (over < -half ? 0 : was);
}

/* Steps 1 to 4: hold the last valid reading and filter it; 1 where the held reading did not change. */
static int load_read(const LoadSettings *s, LoadState *x, const LoadInput *in)
{
    const LoadReal previous = x->held;
    const int valid = load_between(s->load_low, in->load, s->load_high);
    x->bad = valid ? 0 : load_count(x->bad);
    x->spindle = in->spindle_on ? load_count(x->spindle) : 0;
    x->armed = in->enable && x->spindle >= x->n_arm;
    if (!x->armed) x->sparse = 0;
    else if (valid) x->sparse -= x->sparse > 0;
    else if (x->sparse + LOAD_SPARSE_RISE < LOAD_SPARSE_MOST * x->n_lost) x->sparse += LOAD_SPARSE_RISE;
    else x->sparse = LOAD_SPARSE_MOST * x->n_lost;
    if (valid) x->held = in->load;
    else if (!x->armed) x->held = 0;
    x->filtered += (x->held - x->filtered) * x->gain;
    x->measured = x->filtered;
    if (!s->average_command && s->average > 1) x->measured = load_average(s, x, x->filtered);
    x->mean += (x->held - x->mean) * x->overload_gain;
    return !(x->held < previous || x->held > previous);
}

/* Step 5: engage by the filtered load after a delay, disengage at once by the reading too; with LOAD_ADAPTIVE by the
 * mean of a revolution alone, as between teeth there is no force. */
static int load_engage(const LoadSettings *s, LoadState *x)
{
    int engaged;
    x->over = load_compare(x->over, x->measured, s->engage_at, x->half_hysteresis);
    x->above = load_compare(x->above, x->held, s->engage_at, x->half_hysteresis);
    engaged = x->armed && x->over && (x->above || s->law == LOAD_ADAPTIVE);
    x->loaded_for = engaged ? load_count(x->loaded_for) : 0;
    x->clear_for = x->bad == 0 && !x->over && !x->above ? load_count(x->clear_for) : 0;
    return engaged;
}

/* Step 6: the cause of a fault that is present. */
static LoadCause load_cause(const LoadSettings *s, LoadState *x, const LoadInput *in, int equal)
{
    const LoadReal off = (LoadReal)LOAD_PERIOD_SHARE * s->sample_time;
    const int beat = in->beat != 0;
    const int loaded = x->loaded_for >= x->n_engage;
    x->same = loaded && !in->idle && equal ? load_count(x->same) : 0;
    if (x->begun && beat != x->last_beat) x->alive = x->n_beat;
    else if (x->alive > 0) --x->alive;
    x->last_beat = beat;
    if (!x->armed) return LOAD_NO_CAUSE;
    if (x->bad >= x->n_lost || x->sparse >= LOAD_SPARSE_AT * x->n_lost) return LOAD_LOST;
    if (s->stuck_after > 0 && x->same >= x->n_stuck) return LOAD_STUCK;
    if (s->heartbeat > 0 && x->alive == 0) return LOAD_NO_HEARTBEAT;
    if (!(in->requested >= 0 && in->requested < (LoadReal)LOAD_MOST)) return LOAD_REQUESTED_INVALID;
    return load_between(s->sample_time - off, in->period, s->sample_time + off) ? LOAD_NO_CAUSE : LOAD_PERIOD_WRONG;
}

/* Latches fault and overload; a reset clears each whose cause is gone, and worn. */
static void load_latch(const LoadSettings *s, LoadState *x, LoadCause cause, int reset)
{
    const int present = cause != LOAD_NO_CAUSE;
    if (!x->fault || (reset && present)) x->cause = cause;
    x->fault = present || (x->fault && !reset);
    if (!x->fault) x->cause = LOAD_NO_CAUSE;
    x->high_for = x->armed && x->mean > x->overload_above ? load_count(x->high_for) : 0;
    x->overload = x->high_for >= x->n_overload || (x->overload && !reset);
    if (reset) {
        x->worn = 0;
        x->rested = 0;
        if (s->law != LOAD_PI && !x->fault && !x->overload) x->had_cut = 0;
    }
}

/* While the feed is slowed from outside, and until the load has followed it after that, the override does not rise. */
static void load_slow(LoadState *x, const LoadInput *in)
{
    if (in->slowed || x->capped) x->slow = x->n_slow;
    else if (x->slow > 0) --x->slow;
}

/* Whether the sum holds: the output is clipped, or the feed slowed from outside, and the error pushes further. */
static int load_holds(const LoadState *x, LoadReal error)
{
    return !(error * (LoadReal)x->clipped <= 0) || (x->slow > 0 && error > 0);
}

/* Step of pid, with a sum that holds. */
static LoadReal load_position(const LoadSettings *s, LoadState *x, LoadReal error)
{
    LoadReal out;
    if (!load_holds(x, error)) x->sum += error * s->sample_time;
    out = x->bias + s->p * error + s->i * x->sum;
    x->clipped = (out > x->half) - (out < -x->half);
    return x->middle + load_clip(out, -x->half, x->half);
}

/* Equation 16 of doi 10.1109/ACCESS.2023.3330587 inside limits and rates. */
static LoadReal load_incremental(const LoadSettings *s, LoadState *x, LoadReal error)
{
    LoadReal out, least = x->bias - x->fall, most = x->slow > 0 ? x->bias : x->bias + x->rise;
    if (!load_holds(x, error)) x->sum += error;
    out = x->bias + s->p * error + s->i * s->sample_time * x->sum;
    x->clipped = (out > s->high) - (out < s->low);
    x->bias = load_clip(out, s->low > least ? s->low : least, s->high < most ? s->high : most);
    return x->bias;
}

/* An override inside the limits; which of them is active goes to clipped. */
static LoadReal load_inside(const LoadSettings *s, LoadState *x, LoadReal wanted)
{
    x->clipped = (wanted > s->high) - (wanted < s->low);
    return load_clip(wanted, s->low, s->high);
}

/* Feed of the servo times reference over force; from entry it rises at recover until less is asked for. */
static LoadReal load_ratio(const LoadSettings *s, LoadState *x, int entering)
{
    const LoadReal target = load_inside(s, x, x->servo * s->reference / x->measured), most = x->u + x->rise;
    x->soft = (entering || x->soft) && target > x->u;
    return x->soft && target > most ? most : target;
}

/* A sample into the last revolution; its sums are trapezoidal and begin anew with every turn of the ring. */
static void load_push(const LoadSettings *s, LoadState *x)
{
    const LoadReal two = (LoadReal)2;
    const int n = s->average + 1, old = x->ring, after = old + 1 < n ? old + 1 : 0, last = old > 0 ? old - 1 : n - 1;
    int k;
    x->force_sum -= (x->forces[old] + x->forces[after]) / two;
    x->model_sum -= (x->model[old] + x->model[after]) / two;
    x->force_sum += (x->forces[last] + x->held) / two;
    x->model_sum += (x->model[last] + x->wanted) / two;
    x->forces[old] = x->held;
    x->model[old] = x->wanted;
    x->rates[old] = x->wanted_rate;
    x->ring = after;
    if (after != 0) return;
    x->force_sum = 0;
    x->model_sum = 0;
    for (k = 0; k + 1 < n; ++k) {
        x->force_sum += (x->forces[k] + x->forces[k + 1]) / two;
        x->model_sum += (x->model[k] + x->model[k + 1]) / two;
    }
}

/* Before step 7, in every state: the model of the servo, the reference model and the last revolution. */
static void load_track(const LoadSettings *s, LoadState *x)
{
    const LoadReal off = x->wanted - s->reference, rate = x->wanted_rate;
    if (s->law == LOAD_RATIO) x->servo += (x->u - x->servo) * x->servo_gain;
    if (s->law != LOAD_ADAPTIVE) return;
    if (x->cutting) {
        x->wanted = s->reference + s->model_a * off + s->model_b * rate;
        x->wanted_rate = s->model_c * off + s->model_d * rate;
    }
    load_push(s, x);
}

/* The adaptive law begins with the reference model at the measured force. */
static void load_restart(const LoadSettings *s, LoadState *x)
{
    const LoadReal force = x->force_sum / (LoadReal)s->average;
    int k;
    x->wanted = force;
    x->wanted_rate = 0;
    for (k = 0; k <= s->average; ++k) {
        x->model[k] = force;
        x->rates[k] = 0;
    }
    x->model_sum = force * (LoadReal)s->average;
}

/* E = F' - Fd' + lam (F - Fd) of the last revolution, and the trapezoidal step of the estimates. */
static void load_adapt(const LoadSettings *s, LoadState *x, int entering)
{
    const LoadReal n = (LoadReal)s->average, time = n * s->sample_time, two = (LoadReal)2;
    const int old = x->ring, new_ = old > 0 ? old - 1 : s->average;
    const LoadReal w0 = (x->rates[new_] - x->rates[old]) / time, w1 = (x->model[new_] - x->model[old]) / time;
    const LoadReal w2 = x->model_sum / n, error = x->force_sum / n - w2;
    const LoadReal rate = (x->forces[new_] - x->forces[old]) / time - w1;
    const LoadReal E = entering ? rate : rate + s->lam * error, step = (x->last_E + E) / two * s->sample_time;
    if (!entering && x->bad == 0 && x->gap == 0 && x->clipped == 0 && x->above && x->slow == 0) {
        x->m -= s->g1 * step * (w0 + x->last_w[0]) / two;
        x->alpha -= s->g2 * step * (w1 + x->last_w[1]) / two;
        x->beta -= s->g3 * step * (w2 + x->last_w[2]) / two;
    }
    x->last_E = E;
    x->last_w[0] = w0;
    x->last_w[1] = w1;
    x->last_w[2] = w2;
}

/* Feed of m Fd'' + alpha Fd' + beta Fd - Kd E, the reference model taken at the middle of the next period. */
static LoadReal load_adaptive(const LoadSettings *s, LoadState *x, int entering)
{
    const LoadReal two = (LoadReal)2, half = s->sample_time / two, time = s->model_time, damping = s->model_damping;
    LoadReal second, rate, value;
    if (entering) load_restart(s, x);
    load_adapt(s, x, entering);
    second = ((s->reference - x->wanted) / time - two * damping * x->wanted_rate) / time;
    value = x->wanted + x->wanted_rate * half + second * (half * half) / two;
    rate = x->wanted_rate + second * half;
    second = ((s->reference - value) / time - two * damping * rate) / time;
    value = x->m * second + x->alpha * rate + x->beta * value - s->Kd * x->last_E;
    return load_inside(s, x, value / s->feed_programmed);
}

/* While the revolution holds a bridged reading, the last override before it, and later at most that. */
static LoadReal load_bridged(const LoadSettings *s, LoadState *x, LoadReal target, int entering)
{
    if (entering) x->gap = 0;
    if (x->bad > 0) {
        if (x->gap == 0) {
            x->before = x->u;
            x->gaps = 0;
        }
        x->gap = s->average + 1;
    }
    if (x->gap == 0) return target;
    --x->gap;
    x->gaps = load_count(x->gaps);
    if (x->gaps <= x->n_lost + s->average) target = x->u;
    return target < x->before ? target : x->before;
}

/* While readings repeat, as of a sensor that stands still, the override rises at recover from that before the first. */
static LoadReal load_repeated(const LoadSettings *s, LoadState *x, LoadReal target, int entering)
{
    LoadReal most;
    if (entering || x->same == 0) x->base = x->u;
    most = x->base + (LoadReal)x->same * x->rise;
    return s->stuck_after > 0 && x->same > 0 && target > most ? most : target;
}

/* Step 7: override that the control law asks for. */
static LoadReal load_closed(const LoadSettings *s, LoadState *x, LoadReal error, int entering)
{
    LoadReal target;
    int k, held;
    if (s->law != LOAD_PI) {
        x->had_cut = 1;
        if (s->law == LOAD_ADAPTIVE) target = load_bridged(s, x, load_adaptive(s, x, entering), entering);
        else target = load_ratio(s, x, entering);
        target = load_repeated(s, x, target, entering);
        held = !x->above || (x->bad > 0 && s->law != LOAD_ADAPTIVE); /* between teeth, on leaving the cut, bridged */
        return held && target > x->u ? x->u : target;                /* the feed never rises */
    }
    if (entering) {
        x->bias = x->u + s->entry_gain * error;
        if (!s->incremental) x->bias -= x->middle;
        x->sum = 0;
        x->clipped = 0;
        if (s->average_command)
            for (k = 0; k < s->average; ++k) x->kept[k] = x->u;
    }
    x->had_cut = 1;
    target = s->incremental ? load_incremental(s, x, error) : load_position(s, x, error);
    return s->average_command && s->average > 1 ? load_average(s, x, target) : target;
}

/* Step 8 outside of the control law. */
static LoadReal load_open(const LoadSettings *s, LoadState *x, const LoadInput *in)
{
    if (!x->armed && in->idle && in->load - s->engage_at < -x->half_hysteresis) x->had_cut = 0; /* NaN: kept */
    if (x->fault || x->overload || (in->enable && !x->armed)) return s->low;
    if (s->law != LOAD_PI) {
        if (x->had_cut) return x->u < s->approach ? x->u : s->approach;
        return x->clear_for >= x->n_engage ? s->approach : x->u; /* from power-on the lower limit until air is known */
    }
    if (x->had_cut) return x->u;
    return in->enable ? s->low : (LoadReal)1;
}

static void load_limit(const LoadSettings *s, LoadState *x, LoadReal target)
{
    LoadReal most;
    target = load_clip(target, s->low, s->high);
    if (!x->begun) {
        x->u = x->average = target;
        return;
    }
    if (target > x->u || target < x->u) x->falling = target < x->u;
    if (s->law != LOAD_PI && x->cutting) {
        x->u = target;
        return;
    }
    most = x->falling ? x->fall : x->rise;
    x->u = load_clip(target, x->u - most, x->u + most);
}

/* Step 9: the mean override rests on the lower limit; time in air, or at a feed that is slowed from outside with less
 * load than the reference, neither counts nor resets it. */
static void load_rest(const LoadSettings *s, LoadState *x)
{
    x->average += (x->u - x->average) * x->worn_gain;
    if (!x->cutting || (x->slow > 0 && x->measured < s->reference)) return;
    x->rested = x->average <= x->rest ? load_count(x->rested) : 0;
    if (x->rested >= x->n_dwell) x->worn = 1;
}

static void load_stop(LoadOutput *out) /* the state was not initialised */
{
    memset(out, 0, sizeof *out);
    out->state = LOAD_FAULT;
    out->fault = 1;
    out->feed_inhibit = 1;
}

static void load_output(const LoadSettings *s, LoadState *x, const LoadInput *in, LoadOutput *out, int engaged)
{
    LoadReal real, factor;
    const int fault = x->fault || x->overload;
    if (in->requested > 0 && in->requested < (LoadReal)LOAD_MOST) x->factor = s->feed_programmed / in->requested;
    factor = fault && x->factor > (LoadReal)1 ? (LoadReal)1 : x->factor; /* in a fault it only reduces */
    real = x->u * factor;
    out->feed_override = real < (LoadReal)1 ? real : (LoadReal)1;
    x->capped = real > (LoadReal)1; /* the program requests less than u: a rise of u has no effect */
    out->u = x->u;
    out->measured = x->measured;
    out->cause = x->cause;
    out->fault = x->fault;
    out->worn = x->worn;
    out->overload = x->overload;
    out->feed_inhibit = x->overload || (x->fault && s->stop_on_fault);
    if (fault) out->state = LOAD_FAULT;
    else if (x->cutting) out->state = x->worn ? LOAD_WORN : LOAD_CONTROL;
    else if (x->armed) out->state = engaged ? LOAD_ENTRY : LOAD_AIR;
    else out->state = LOAD_OFF;
}

void load_control_step(const LoadSettings *s, LoadState *x, const LoadInput *in, LoadOutput *out)
{
    int equal, engaged, reset, cutting;
    LoadReal target;
    if (x->ready != LOAD_READY) {
        load_stop(out);
        return;
    }
    equal = load_read(s, x, in);
    engaged = load_engage(s, x);
    reset = in->reset && !x->last_reset;
    x->last_reset = in->reset != 0;
    load_latch(s, x, load_cause(s, x, in, equal), reset);
    load_slow(x, in);
    load_track(s, x);
    cutting = x->loaded_for >= x->n_engage && !x->fault && !x->overload && !in->idle;
    if (cutting) target = load_closed(s, x, s->reference - x->measured, !x->cutting);
    else target = load_open(s, x, in);
    if (cutting && x->slow > 0 && target > x->u) target = x->u;
    x->cutting = cutting;
    load_limit(s, x, target);
    load_rest(s, x);
    load_output(s, x, in, out, engaged);
    x->begun = 1;
}
#endif

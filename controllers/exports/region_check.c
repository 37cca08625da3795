/* Limits on a pair of cutting speed and feed, at a depth, a time in the cut and a wear: firmware, LinuxCNC and FMI.
 *
 * C90, no allocation, no global state, one call per period. Use:
 *
 *     static RegionState state;
 *     RegionInput input; RegionOutput output;
 *     if (region_check_init(&region_settings, &state) != 0) stop();
 *     every sample_time seconds:  fill input;  region_check_step(&region_settings, &state, &input, &output);
 *
 * In a second file, #define REGION_CHECK_DECLARATIONS_ONLY before including this one. For single precision compile
 * every file with -DREGION_CHECK_REAL=float. Do not compile with -ffast-math: it removes the tests for NaN.
 * Each limit is linear in the logarithms of V, f, d, t, wear and diameter. A depth, time or diameter outside its tested
 * range counts as the worse of value and end; while a fault is latched both ends count too. A measured wear counts
 * beside the wear by its law, and the worse of both holds: a gauge that reads low releases no limit.
 */
#ifndef REGION_CHECK_DECLARATIONS
#define REGION_CHECK_DECLARATIONS

#ifdef __FAST_MATH__
#error "region_check needs NaN: compile without -ffast-math"
#endif
#ifndef REGION_CHECK_REAL
#define REGION_CHECK_REAL double
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef REGION_CHECK_REAL RegionReal;

typedef enum {
    REGION_NO_CAUSE,
    REGION_PAIR_WRONG,     /* V or f is negative or none: both overrides are 0 */
    REGION_TIME_WRONG,     /* t is not 0 or above */
    REGION_DEPTH_WRONG,    /* d is not above 0 */
    REGION_DIAMETER_WRONG, /* outside its range, or it jumped */
    REGION_WEAR_WRONG,     /* measured wear is negative, none, above ten times the criterion or far below its law */
    REGION_PERIOD_WRONG    /* the period is not above 0 and at most 1 s */
} RegionCause;

enum { REGION_V, REGION_F, REGION_D, REGION_T, REGION_DIAMETER, REGION_FACTORS };

typedef struct {
    RegionReal constant;            /* excess = constant + by . ln(V, f, d, t, diameter) + by_wear ln(wear) */
    RegionReal by[REGION_FACTORS]; /* above 0 the limit is exceeded, in logarithms */
    RegionReal by_wear;
} RegionLimit;

typedef struct {
    RegionReal low, high; /* tested range; of the diameter that of the work */
} RegionRange;

typedef struct {
    RegionReal sample_time;   /* s: period of the calls */
    RegionReal wear_most;     /* a measured wear above ten times this is a fault */
    RegionReal diameter_rate; /* mm/s: fastest plausible change */
    RegionLimit wear;         /* ln(wear) by V, f, d, t, the law of wear; by_wear 0 */
    RegionRange tested[REGION_FACTORS];
    const RegionLimit *limit;
    int limits;
    int diameter_read; /* 1: a limit has the diameter */
    int wear_read;     /* 1: a limit has the wear */
} RegionSettings;

typedef struct {
    RegionReal period;   /* s since the last call, measured */
    RegionReal V;        /* m/min; 0 at rest: both overrides are 0 */
    RegionReal f;        /* mm/rev, before feed_override; 0 at rest */
    RegionReal d;        /* mm */
    RegionReal t;        /* min in the cut of this edge */
    RegionReal wear;     /* measured wear, which can only tighten the limits; 0: by its law alone */
    RegionReal diameter; /* mm, at the edge */
    int reset;           /* a change from 0 to 1 clears a fault whose cause is gone */
} RegionInput;

typedef struct {
    RegionReal excess;         /* of the binding limit, logarithm of response over limit; not above 0: kept */
    RegionReal use;            /* of the binding limit: response over limit */
    RegionReal feed_override;  /* largest factor of f, at most 1, that keeps every limit at this V; 0: none does */
    RegionReal speed_override; /* the same of V at this f */
    int binding;               /* number of the limit with the largest excess, 1 the first */
    int within;                /* every limit is kept */
    int tested;                /* V, f, d each in its tested range, t not beyond; combination not checked */
    int fault;                 /* latched */
    RegionCause cause;         /* of the fault, the first one */
    int feed_inhibit;          /* stop the feed: no feed at this V keeps the limits */
} RegionOutput;

typedef struct {
    RegionReal held, t, expected;
    int ready, measured, followed, last_reset, fault;
    RegionCause cause;
} RegionState;

/* 0, or the number of the first setting (1: sample_time) that is out of range. */
int region_check_init(const RegionSettings *s, RegionState *x);
void region_check_step(const RegionSettings *s, RegionState *x, const RegionInput *in, RegionOutput *out);

#ifdef __cplusplus
}
#endif
#endif

#ifndef REGION_CHECK_DECLARATIONS_ONLY
#include <string.h>
#ifdef RTAPI
#include "rtapi_math.h"
#else
#include <math.h>
#endif

#define REGION_LONGEST_PERIOD 1.0 /* s */
#define REGION_MOST 1e9           /* a number at or above is none */
#define REGION_LEAST 1e-12        /* stands for 0, which has no logarithm */
#define REGION_MOST_WEAR 10.0     /* of wear_most */
#define REGION_LEAST_WEAR 0.6     /* of the wear that the law expects after the pairs cut so far */
#define REGION_SLACK 0.05         /* mm: of the diameter between two calls */
#define REGION_SAME 1e-9          /* in logarithms: a limit met to so much is kept */
#define REGION_READY 0x5243

static int region_above(RegionReal x) { return x > 0 && x < (RegionReal)REGION_MOST; } /* NaN: 0 */

static RegionReal region_ln(RegionReal x)
{
    return (RegionReal)log(x > (RegionReal)REGION_LEAST ? (double)x : REGION_LEAST);
}

int region_check_init(const RegionSettings *s, RegionState *x)
{
    int k;
    memset(x, 0, sizeof *x);
    if (!(s->sample_time > 0 && s->sample_time <= (RegionReal)REGION_LONGEST_PERIOD)) return 1;
    if (!region_above(s->wear_most)) return 2;
    if (!region_above(s->diameter_rate)) return 3;
    for (k = 0; k < REGION_FACTORS; ++k)
        if (!(region_above(s->tested[k].low) && region_above(s->tested[k].high) &&
              s->tested[k].low <= s->tested[k].high))
            return 5;
    if (s->limits < 1 || !s->limit) return 6;
    x->ready = REGION_READY;
    return 0;
}

/* Step 1: the diameter, one of its range where it is not known: both ends count then. */
static RegionReal region_diameter(const RegionSettings *s, RegionState *x, const RegionInput *in, RegionCause *cause)
{
    const RegionRange *range = &s->tested[REGION_DIAMETER];
    const RegionReal most = s->diameter_rate * in->period + (RegionReal)REGION_SLACK;
    RegionReal change;
    if (!s->diameter_read) return range->high;
    if (!(range->low < range->high)) return range->high;
    if (!(range->low <= in->diameter && in->diameter <= range->high)) {
        *cause = REGION_DIAMETER_WRONG;
        x->measured = 0;
        return range->high;
    }
    change = in->diameter - x->held;
    if (x->measured && !(-most <= change && change <= most)) *cause = REGION_DIAMETER_WRONG;
    x->held = in->diameter;
    x->measured = 1;
    return x->held;
}

static int region_inside(const RegionRange *range, RegionReal x) { return range->low <= x && x <= range->high; }

/* Wear by its law at a time with the pair and depth of now. */
static RegionReal region_wear(const RegionSettings *s, const RegionInput *in, RegionReal t)
{
    const RegionReal *by = s->wear.by, of_pair = by[REGION_V] * region_ln(in->V) + by[REGION_F] * region_ln(in->f);
    return (RegionReal)exp((double)(s->wear.constant + of_pair + by[REGION_D] * region_ln(in->d) +
                                    by[REGION_T] * region_ln(t)));
}

/* Step 2: wear that the law expects after the pairs cut so far, which a reading must not be far below; 0 where the law
 * is not tested. A time that falls begins a new edge; what was cut before power on counts as cut with this pair. */
static RegionReal region_expected(const RegionSettings *s, RegionState *x, const RegionInput *in)
{
    RegionReal pair[REGION_T], now;
    int k;
    pair[REGION_V] = in->V;
    pair[REGION_F] = in->f;
    pair[REGION_D] = in->d;
    if (!s->wear_read || !(in->t >= 0 && in->t < (RegionReal)REGION_MOST)) return 0;
    for (k = 0; k < REGION_T; ++k)
        if (!region_inside(&s->tested[k], pair[k])) return 0;
    now = region_wear(s, in, in->t);
    if (x->followed && in->t >= x->t && s->wear.by[REGION_T] > 0)
        x->expected += now - region_wear(s, in, x->t);
    else
        x->expected = now;
    x->t = in->t;
    x->followed = 1;
    return in->t >= s->tested[REGION_T].low ? x->expected : 0;
}

static int region_measured(const RegionSettings *s, RegionReal wear)
{
    return wear > 0 && wear <= (RegionReal)REGION_MOST_WEAR * s->wear_most;
}

/* Step 3: the cause of a fault that is present, the first of them. */
static RegionCause region_cause(const RegionSettings *s, const RegionInput *in, RegionReal expected,
                                RegionCause of_diameter)
{
    if (!(in->V >= 0 && in->V < (RegionReal)REGION_MOST)) return REGION_PAIR_WRONG;
    if (!(in->f >= 0 && in->f < (RegionReal)REGION_MOST)) return REGION_PAIR_WRONG;
    if (!(in->t >= 0 && in->t < (RegionReal)REGION_MOST)) return REGION_TIME_WRONG;
    if (!region_above(in->d)) return REGION_DEPTH_WRONG;
    if (s->wear_read && !(in->wear >= 0 && in->wear <= 0) &&
        !(region_measured(s, in->wear) && in->wear >= (RegionReal)REGION_LEAST_WEAR * expected))
        return REGION_WEAR_WRONG; /* 0 is none */
    if (!(in->period > 0 && in->period <= (RegionReal)REGION_LONGEST_PERIOD)) return REGION_PERIOD_WRONG;
    return of_diameter;
}

/* Contribution of a factor to a limit: value, or the end of the tested range that is worse where it lies outside, or
 * where it is not known the worse end, or a value beyond it that is worse still. */
static RegionReal region_part(const RegionRange *range, RegionReal by, RegionReal value, int known)
{
    const RegionReal low = by * region_ln(range->low), high = by * region_ln(range->high);
    const RegionReal worse = low > high ? low : high;
    RegionReal at;
    if (!(value >= 0 && value < (RegionReal)REGION_MOST)) return worse;
    at = by * region_ln(value);
    if (!known) return at > worse ? at : worse;
    if (value < range->low) return at > low ? at : low;
    if (value > range->high) return at > high ? at : high;
    return at;
}

/* Step 4: excess of a limit by the measured wear or by its law; by_f and by_V are its slopes. */
static RegionReal region_excess(const RegionSettings *s, int k, const RegionReal *value, RegionReal ln_wear,
                                int measured, int known, RegionReal *by_V, RegionReal *by_f)
{
    const RegionLimit *limit = &s->limit[k];
    RegionReal by[REGION_FACTORS], out = limit->constant;
    int i;
    for (i = 0; i < REGION_FACTORS; ++i)
        by[i] = measured ? limit->by[i] : limit->by[i] + limit->by_wear * s->wear.by[i];
    out += limit->by_wear * (measured ? ln_wear : s->wear.constant);
    out += by[REGION_V] * region_ln(value[REGION_V]) + by[REGION_F] * region_ln(value[REGION_F]);
    for (i = REGION_D; i < REGION_FACTORS; ++i) out += region_part(&s->tested[i], by[i], value[i], known);
    *by_V = by[REGION_V];
    *by_f = by[REGION_F];
    return out;
}

typedef struct {
    RegionReal least, most; /* logarithms of the factors that keep the limits, at most 0 */
    int none;
} RegionSpan;

static void region_narrow(RegionSpan *span, RegionReal excess, RegionReal slope)
{
    const RegionReal end = slope > 0 || slope < 0 ? -excess / slope : 0;
    if (slope > 0) {
        if (end < span->most) span->most = end;
    } else if (slope < 0) {
        if (end > span->least) span->least = end;
    } else if (excess > (RegionReal)REGION_SAME)
        span->none = 1;
}

static RegionReal region_factor(const RegionSpan *span)
{
    if (span->none || span->least > span->most + (RegionReal)REGION_SAME) return 0;
    return (RegionReal)exp((double)span->most);
}

static int region_tested(const RegionSettings *s, const RegionReal *value)
{
    int i, in = 1;
    for (i = 0; i < REGION_DIAMETER; ++i)
        if (!(region_inside(&s->tested[i], value[i]) || (i == REGION_T && value[i] <= s->tested[i].high))) in = 0;
    return in;
}

static void region_evaluate(const RegionSettings *s, const RegionInput *in, RegionOutput *out, RegionReal diameter,
                            int known)
{
    const int measured = s->wear_read && region_measured(s, in->wear);
    const RegionReal ln_wear = measured ? region_ln(in->wear) : 0;
    RegionSpan of_feed, of_speed;
    RegionReal value[REGION_FACTORS], excess, by_V, by_f;
    int k, of_gauge;
    value[REGION_V] = in->V;
    value[REGION_F] = in->f;
    value[REGION_D] = in->d;
    value[REGION_T] = in->t;
    value[REGION_DIAMETER] = diameter;
    memset(&of_feed, 0, sizeof of_feed);
    of_feed.least = -(RegionReal)REGION_MOST;
    of_speed = of_feed;
    for (k = 0; k < s->limits; ++k)
        for (of_gauge = 0; of_gauge <= (measured && (s->limit[k].by_wear > 0 || s->limit[k].by_wear < 0)); ++of_gauge) {
            excess = region_excess(s, k, value, ln_wear, of_gauge, known, &by_V, &by_f);
            if (out->binding == 0 || excess > out->excess) {
                out->excess = excess;
                out->binding = k + 1;
            }
            region_narrow(&of_feed, excess, by_f);
            region_narrow(&of_speed, excess, by_V);
        }
    out->use = (RegionReal)exp((double)out->excess);
    out->within = out->excess <= (RegionReal)REGION_SAME;
    out->feed_override = region_factor(&of_feed);
    out->speed_override = region_factor(&of_speed);
    out->tested = region_tested(s, value);
}

void region_check_step(const RegionSettings *s, RegionState *x, const RegionInput *in, RegionOutput *out)
{
    RegionCause cause = REGION_NO_CAUSE;
    RegionReal diameter;
    int reset;
    memset(out, 0, sizeof *out);
    out->fault = 1;
    out->feed_inhibit = 1;
    if (x->ready != REGION_READY) return;
    diameter = region_diameter(s, x, in, &cause);
    cause = region_cause(s, in, region_expected(s, x, in), cause);
    reset = in->reset && !x->last_reset;
    x->last_reset = in->reset != 0;
    if (cause != REGION_NO_CAUSE) {
        if (!x->fault || reset) x->cause = cause;
        x->fault = 1;
    } else if (reset)
        x->fault = 0;
    if (!x->fault) x->cause = REGION_NO_CAUSE;
    out->fault = x->fault;
    out->cause = x->cause;
    out->feed_inhibit = x->fault;
    if (!(in->V > 0 && in->f > 0) || cause == REGION_PAIR_WRONG) return;
    region_evaluate(s, in, out, diameter, !x->fault);
    out->feed_inhibit = !(out->feed_override > 0);
}
#endif

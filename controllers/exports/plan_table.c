/* Plan of cutting speed and feed over the time in the cut of one edge: firmware, LinuxCNC (halcompile) and FMI.
 *
 * C90, no allocation, no global state, one call per period. Use:
 *
 *     static PlanState state;
 *     PlanInput input; PlanOutput output;
 *     if (plan_table_init(&plan_settings, &state) != 0) stop();
 *     every sample_time seconds:  fill input;  plan_table_step(&plan_settings, &state, &input, &output);
 *
 * In a second file, #define PLAN_TABLE_DECLARATIONS_ONLY before including this one. For single precision compile
 * every file with -DPLAN_TABLE_REAL=float. Do not compile with -ffast-math: it removes the tests for NaN.
 * After power on the time in the cut is not known: the slowest row holds, latched, until set_elapsed or new_edge, and
 * elapsed_min is negative. Keep it through a power cut only where it is not: if (output.elapsed_min >= 0) keep it.
 * A state that plan_table_init did not accept gives speed and feed 0 and feed_inhibit 1.
 */
#ifndef PLAN_TABLE_DECLARATIONS
#define PLAN_TABLE_DECLARATIONS

#ifdef __FAST_MATH__
#error "plan_table needs NaN: compile without -ffast-math"
#endif
#ifndef PLAN_TABLE_REAL
#define PLAN_TABLE_REAL double
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef PLAN_TABLE_REAL PlanReal;

typedef enum {
    PLAN_NO_CAUSE,
    PLAN_ELAPSED_UNKNOWN, /* since power on neither elapsed nor a new edge was set; a reset does not clear it */
    PLAN_PERIOD_WRONG,    /* the period is not above 0 and at most 1 s */
    PLAN_DIAMETER_WRONG,  /* outside its range, or it jumped */
    PLAN_WEAR_WRONG,      /* measured wear is negative, none, above ten times the criterion, below half of the last or,
                             after the first row, below 0.6 of the plan */
    PLAN_ELAPSED_WRONG    /* new_edge rose in the cut, set_elapsed with a known time too, or elapsed is out of range */
} PlanCause;

typedef struct {
    PlanReal end;  /* s in the cut at which the row ends */
    PlanReal V;    /* m/min */
    PlanReal f;    /* mm/rev */
    PlanReal wear; /* at the end, in the unit of the wear */
} PlanRow;

typedef struct {
    PlanReal sample_time;     /* s: period of the calls */
    PlanReal wear_most;       /* wear: criterion */
    PlanReal wear_exponent;   /* within a row wear grows with the time to this power */
    PlanReal wear_tolerance;  /* share by which measured wear may exceed the plan without effect */
    PlanReal diameter_low;    /* mm; equal to diameter_high: the input diameter is not read */
    PlanReal diameter_high;   /* mm */
    PlanReal diameter_rate;   /* mm/s: fastest plausible change */
    PlanReal spindle_high;    /* 1/min */
    PlanReal feed_rate_high;  /* mm/min */
    PlanReal spindle_rise;    /* 1/min per s: the spindle accelerates at least so fast */
    PlanReal feed_programmed; /* mm/rev: feed at which feed_override is 1, the largest of the plan */
    PlanReal feed_unknown;    /* mm/rev: most while the diameter is not known; 0: feed_inhibit then */
    PlanReal overrun;         /* s in the cut with a worn edge, or an unknown one, until feed_inhibit */
    const PlanRow *row;
    int rows;
    int slowest;    /* row of the least removal rate that keeps the limits at the end of the plan, 1 the first */
    int wear_state; /* 1: wear^(1/wear_exponent) grows evenly in a row; 0: wear grows by the time since the new edge */
} PlanSettings;

typedef struct {
    PlanReal period;   /* s since the last call, measured */
    PlanReal diameter; /* mm, at the edge */
    PlanReal wear;     /* measured wear; 0: none, also where the last reading is not new */
    PlanReal elapsed;  /* min in the cut of this edge, read when set_elapsed rises */
    int cutting;       /* the tool is in the cut: the time counts */
    int new_edge;      /* a change from 0 to 1 out of the cut: time 0 */
    int set_elapsed;   /* a change from 0 to 1 out of the cut: the time is elapsed; a known time is never lowered. After
                          power on one in the cut waits for its end, and what was cut since is added to elapsed */
    int reset;         /* a change from 0 to 1 clears a fault whose cause is gone; time, worn and overrun stay */
} PlanInput;

typedef struct {
    PlanReal spindle_speed; /* 1/min */
    PlanReal cutting_speed; /* m/min, of that spindle speed */
    PlanReal feed;          /* mm/rev */
    PlanReal feed_rate;     /* mm/min; while the spindle accelerates that of the speed it has at least */
    PlanReal feed_override; /* feed / feed_programmed, at most 1 */
    PlanReal elapsed_min;   /* min in the cut, negative where not known: keep it through a power cut where it is not */
    PlanReal wear_expected; /* that the plan expects now */
    int row;                /* in force, 1 the first */
    int worn;               /* latched until new_edge: change the edge */
    int fault;              /* latched: the slowest row holds */
    PlanCause cause;        /* of the fault, the first one */
    int limited;            /* spindle speed or feed is at its cap */
    int feed_inhibit;       /* stop the feed: overrun is used up */
} PlanOutput;

typedef struct {
    PlanReal rest, held, last_wear, slow, overrun;
    long seconds;
    int ready, known, measured, lost, row, last_new, last_set, last_reset, fault, worn;
    PlanCause cause;
} PlanState;

/* 0, or the number of the first setting (1: sample_time) that is out of range; 14 to 16: the rows. */
int plan_table_init(const PlanSettings *s, PlanState *x);
void plan_table_step(const PlanSettings *s, PlanState *x, const PlanInput *in, PlanOutput *out);

#ifdef __cplusplus
}
#endif
#endif

#ifndef PLAN_TABLE_DECLARATIONS_ONLY
#include <string.h>
#ifdef RTAPI
#include "rtapi_math.h"
#else
#include <math.h>
#endif

#define PLAN_LONGEST_PERIOD 1.0 /* s */
#define PLAN_LONGEST 1000000000L /* s: the time stops there */
#define PLAN_MOST 1e9           /* a number at or above is none */
#define PLAN_MOST_WEAR 10.0     /* of the criterion */
#define PLAN_LEAST_WEAR 0.5     /* of the last measured wear */
#define PLAN_LEAST_SHARE 0.6    /* of the wear that the plan expects, after the first row */
#define PLAN_SLACK 0.05         /* mm: of the diameter between two calls */
#define PLAN_RADIAL 4.0         /* mm of the diameter per mm of feed: a facing cut moves it by 2 */
#define PLAN_READY 0x504c
#define PLAN_PI 3.14159265358979323846

static int plan_between(PlanReal low, PlanReal x, PlanReal high) { return low <= x && x <= high; } /* NaN: 0 */

static PlanReal plan_power(PlanReal x, PlanReal h) /* 0 at 0 */
{
    return x > 0 ? (PlanReal)exp((double)h * log((double)x)) : (PlanReal)0;
}

static int plan_above(PlanReal x) { return x > 0 && x < (PlanReal)PLAN_MOST; }

static int plan_first_wrong(const PlanSettings *s)
{
    if (!(s->sample_time > 0 && s->sample_time <= (PlanReal)PLAN_LONGEST_PERIOD)) return 1;
    if (!plan_above(s->wear_most)) return 2;
    if (!plan_above(s->wear_exponent)) return 3;
    if (!plan_between(0, s->wear_tolerance, 1)) return 4;
    if (!plan_above(s->diameter_low)) return 5;
    if (!(plan_above(s->diameter_high) && s->diameter_low <= s->diameter_high)) return 6;
    if (!plan_above(s->diameter_rate)) return 7;
    if (!plan_above(s->spindle_high)) return 8;
    if (!plan_above(s->feed_rate_high)) return 9;
    if (!plan_above(s->spindle_rise)) return 10;
    if (!plan_above(s->feed_programmed)) return 11;
    if (!plan_between(0, s->feed_unknown, s->feed_programmed)) return 12;
    if (!plan_between(0, s->overrun, (PlanReal)PLAN_MOST)) return 13;
    if (s->rows < 1 || !s->row) return 14;
    return s->slowest < 1 || s->slowest > s->rows ? 15 : 0;
}

static int plan_rows_wrong(const PlanSettings *s)
{
    PlanReal end = 0, wear = 0;
    int k;
    for (k = 0; k < s->rows; ++k) {
        const PlanRow *row = &s->row[k];
        if (!(row->end > end && plan_above(row->end) && row->wear > wear && plan_above(row->wear))) return 16;
        if (!(plan_above(row->V) && row->f > 0 && row->f <= s->feed_programmed)) return 16;
        end = row->end;
        wear = row->wear;
    }
    return 0;
}

int plan_table_init(const PlanSettings *s, PlanState *x)
{
    int wrong = plan_first_wrong(s);
    memset(x, 0, sizeof *x);
    if (wrong == 0) wrong = plan_rows_wrong(s);
    if (wrong != 0) return wrong;
    x->fault = 1;
    x->cause = PLAN_ELAPSED_UNKNOWN;
    x->ready = PLAN_READY;
    return 0;
}

static PlanReal plan_time(const PlanState *x) { return (PlanReal)x->seconds + x->rest; }

static void plan_set_time(PlanState *x, PlanReal time) /* never earlier */
{
    if (!(time > plan_time(x))) return;
    x->seconds = (long)time;
    x->rest = time - (PlanReal)x->seconds;
}

/* Beginning of a row and the wear there. */
static PlanReal plan_start(const PlanSettings *s, int k) { return k > 0 ? s->row[k - 1].end : (PlanReal)0; }
static PlanReal plan_before(const PlanSettings *s, int k) { return k > 0 ? s->row[k - 1].wear : (PlanReal)0; }

/* Wear that the plan expects after a time within row k. */
static PlanReal plan_wear(const PlanSettings *s, int k, PlanReal time)
{
    const PlanReal h = s->wear_exponent, start = plan_start(s, k), end = s->row[k].end;
    const PlanReal before = plan_before(s, k), after = s->row[k].wear;
    if (time >= end) return after;
    if (s->wear_state) {
        const PlanReal u = (PlanReal)1 / h, low = plan_power(before, u), high = plan_power(after, u);
        return plan_power(low + (high - low) * (time - start) / (end - start), h);
    }
    return before + (after - before) * (plan_power(time, h) - plan_power(start, h)) /
                        (plan_power(end, h) - plan_power(start, h));
}

/* Time after which the plan expects a wear: the inverse of plan_wear over all rows. */
static PlanReal plan_time_of(const PlanSettings *s, PlanReal wear)
{
    const PlanReal h = s->wear_exponent;
    PlanReal start, end, before, share;
    int k = 0;
    while (k < s->rows && s->row[k].wear < wear) ++k;
    if (k == s->rows) return s->row[k - 1].end;
    start = plan_start(s, k);
    end = s->row[k].end;
    before = plan_before(s, k);
    if (s->wear_state) {
        const PlanReal u = (PlanReal)1 / h, low = plan_power(before, u);
        return start + (end - start) * (plan_power(wear, u) - low) / (plan_power(s->row[k].wear, u) - low);
    }
    share = (wear - before) / (s->row[k].wear - before);
    return plan_power(plan_power(start, h) + share * (plan_power(end, h) - plan_power(start, h)), (PlanReal)1 / h);
}

/* Step 1: a new edge, which clears what belongs to the last one, or an elapsed time. */
static PlanCause plan_set_edge(PlanState *x, const PlanInput *in)
{
    const int fresh = in->new_edge && !x->last_new, taken = x->known || !in->cutting;
    const int restored = in->set_elapsed && !x->last_set && taken;
    x->last_new = in->new_edge != 0;
    x->last_set = in->set_elapsed && (x->last_set || taken);
    if ((fresh || restored) && in->cutting) return PLAN_ELAPSED_WRONG;
    if (restored && !fresh && !plan_between(0, in->elapsed, (PlanReal)(PLAN_MOST / 60.0))) return PLAN_ELAPSED_WRONG;
    if (fresh) {
        x->seconds = 0;
        x->rest = 0;
        x->row = 0;
        x->worn = 0;
        x->last_wear = 0;
        x->overrun = 0;
    } else if (restored)
        plan_set_time(x, in->elapsed * (PlanReal)60 + (x->known ? 0 : plan_time(x)));
    if (!fresh && !restored) return PLAN_NO_CAUSE;
    x->known = 1;
    if (x->fault && x->cause == PLAN_ELAPSED_UNKNOWN) x->fault = 0;
    return PLAN_NO_CAUSE;
}

/* Step 2: time in the cut; one that cannot be measured counts as the longest period. */
static PlanReal plan_count(const PlanSettings *s, PlanState *x, const PlanInput *in, PlanCause *cause)
{
    PlanReal step = in->period;
    long whole;
    if (!(step > 0 && step <= (PlanReal)PLAN_LONGEST_PERIOD)) {
        *cause = PLAN_PERIOD_WRONG;
        if (!plan_above(step)) step = (PlanReal)PLAN_LONGEST_PERIOD;
    }
    if (!in->cutting) return step;
    x->rest += step;
    whole = (long)(x->rest + (step < (PlanReal)1 ? step : (PlanReal)1) / (PlanReal)2); /* a whole second but rounding */
    if (whole > 0 && x->seconds < PLAN_LONGEST) x->seconds += whole;
    x->rest -= (PlanReal)whole;
    if ((x->worn || !x->known) && x->overrun <= s->overrun) x->overrun += step;
    return step;
}

/* Step 3: measured wear above the plan at this moment moves the time on, never back; far below it is a fault. */
static PlanCause plan_measured(const PlanSettings *s, PlanState *x, PlanReal wear)
{
    const PlanReal expected = plan_wear(s, x->row, plan_time(x));
    if (plan_between(0, wear, 0)) return PLAN_NO_CAUSE;
    if (!plan_between(0, wear, (PlanReal)PLAN_MOST_WEAR * s->wear_most)) return PLAN_WEAR_WRONG;
    if (wear < (PlanReal)PLAN_LEAST_WEAR * x->last_wear) return PLAN_WEAR_WRONG;
    if (x->known && plan_time(x) >= s->row[0].end && wear < (PlanReal)PLAN_LEAST_SHARE * expected)
        return PLAN_WEAR_WRONG;
    x->last_wear = wear;
    if (wear >= s->wear_most) x->worn = 1;
    if (x->known && wear > ((PlanReal)1 + s->wear_tolerance) * expected) plan_set_time(x, plan_time_of(s, wear));
    return PLAN_NO_CAUSE;
}

/* Step 4: diameter at the edge; where it is not known the largest, whose spindle speed is the least. It is not known
 * again until the fault that was latched then is gone or a reset finds a plausible one. */
static PlanReal plan_diameter(const PlanSettings *s, PlanState *x, const PlanInput *in, PlanReal step, int reset,
                              PlanCause *cause)
{
    PlanReal most, rate;
    if (!(s->diameter_low < s->diameter_high)) return s->diameter_high;
    if (!plan_between(s->diameter_low, in->diameter, s->diameter_high)) {
        *cause = PLAN_DIAMETER_WRONG;
        x->measured = 0;
        x->lost = 1;
        return s->diameter_high;
    }
    rate = (PlanReal)PLAN_RADIAL * s->feed_programmed * x->slow / (PlanReal)60;
    most = (in->cutting && rate < s->diameter_rate ? rate : s->diameter_rate) * step + (PlanReal)PLAN_SLACK;
    if (x->measured && !plan_between(-most, in->diameter - x->held, most)) *cause = PLAN_DIAMETER_WRONG;
    x->held = in->diameter;
    x->measured = 1;
    x->lost = *cause == PLAN_DIAMETER_WRONG || (x->lost && x->fault && !reset);
    return x->lost ? s->diameter_high : x->held;
}

static void plan_latch(PlanState *x, PlanCause cause, int reset)
{
    if (cause == PLAN_NO_CAUSE && !x->known) cause = PLAN_ELAPSED_UNKNOWN;
    if (cause != PLAN_NO_CAUSE) {
        if (!x->fault || reset) x->cause = cause;
        x->fault = 1;
    } else if (reset)
        x->fault = 0;
    if (!x->fault) x->cause = PLAN_NO_CAUSE;
}

/* Step 5: the row of the time. */
static int plan_row(const PlanSettings *s, PlanState *x, PlanReal step)
{
    const PlanReal time = plan_time(x) + step / (PlanReal)2;
    while (x->row < s->rows - 1 && s->row[x->row].end <= time) ++x->row;
    if (s->row[s->rows - 1].end <= time) x->worn = 1;
    return x->fault || x->worn ? s->slowest - 1 : x->row;
}

/* Step 6: speed and feed within the caps. A falling spindle takes the feed rate along at once, a rising one lags. */
static void plan_output(const PlanSettings *s, PlanState *x, PlanOutput *out, PlanReal diameter, PlanReal step, int k)
{
    const PlanReal round = (PlanReal)PLAN_PI * diameter / (PlanReal)1000; /* m */
    PlanReal n = s->row[k].V / round, f = s->row[k].f;
    if (x->lost && s->feed_unknown < f) f = s->feed_unknown;
    out->limited = n > s->spindle_high;
    if (out->limited) n = s->spindle_high;
    if (f * n > s->feed_rate_high) {
        f = s->feed_rate_high / n;
        out->limited = 1;
    }
    x->slow += s->spindle_rise * step;
    if (!(x->slow < n)) x->slow = n;
    out->spindle_speed = n;
    out->cutting_speed = n * round;
    out->feed = f;
    out->feed_rate = f * x->slow;
    out->feed_override = f / s->feed_programmed;
    out->elapsed_min = x->known ? plan_time(x) / (PlanReal)60 : -1;
    out->wear_expected = plan_wear(s, x->row, plan_time(x));
    out->row = k + 1;
    out->worn = x->worn;
    out->fault = x->fault;
    out->cause = x->cause;
    out->feed_inhibit = ((x->worn || !x->known) && x->overrun > s->overrun) || !(f > 0);
}

void plan_table_step(const PlanSettings *s, PlanState *x, const PlanInput *in, PlanOutput *out)
{
    PlanCause cause, found;
    PlanReal step, diameter;
    int reset;
    if (x->ready != PLAN_READY) {
        memset(out, 0, sizeof *out);
        out->elapsed_min = -1;
        out->fault = 1;
        out->feed_inhibit = 1;
        return;
    }
    reset = in->reset && !x->last_reset;
    x->last_reset = in->reset != 0;
    cause = plan_set_edge(x, in);
    step = plan_count(s, x, in, &cause);
    found = plan_measured(s, x, in->wear);
    if (found != PLAN_NO_CAUSE) cause = found;
    diameter = plan_diameter(s, x, in, step, reset, &cause);
    plan_latch(x, cause, reset);
    plan_output(s, x, out, diameter, step, plan_row(s, x, step));
}
#endif

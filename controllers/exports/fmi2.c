/* FMI 2.0 co-simulation interface of controller.c: one call of CONTROL_STEP in each communication step, which lasts
 * the sample time of the controller. The lines above this one name its types and functions (CONTROL_), its start values
 * and its variables: REALS, INTEGERS and BOOLEANS list value reference and member of the input or output, as
 * modelDescription.xml has them.
 */
#define PERIOD_SHARE 0.01 /* of the sample time */

typedef enum { INSTANTIATED, INITIALIZATION, STEP, TERMINATED } Mode;

typedef struct {
    ControlState state;
    ControlInput in;
    ControlOutput out;
    fmi2Real time;
    Mode mode;
} Snapshot;

typedef struct {
    Snapshot now;
    fmi2CallbackFunctions callbacks;
    char name[64];
} Instance;

static fmi2Status refuse(Instance *m, const char *text, double value)
{
    if (m->callbacks.logger)
        m->callbacks.logger(m->callbacks.componentEnvironment, m->name, fmi2Error, "logStatusError", text, value);
    return fmi2Error;
}

static int start(Instance *m)
{
    memset(&m->now, 0, sizeof m->now);
    m->now.in.period = CONTROL_PERIOD;
    CONTROL_START(m->now)
    return CONTROL_INIT(&m->now.state);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String folder,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *m;
    (void)folder; (void)visible; (void)logging;
    if (!callbacks || type != fmi2CoSimulation || !guid || strcmp(guid, FMU_GUID) != 0) return NULL;
    m = (Instance *)calloc(1, sizeof *m);
    if (!m) return NULL;
    m->callbacks = *callbacks;
    strncpy(m->name, name ? name : CONTROL_NAME, sizeof m->name - 1);
    if (start(m) != 0) {
        free(m);
        return NULL;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean useTolerance, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean useStop, fmi2Real stopTime)
{
    (void)useTolerance; (void)tolerance; (void)useStop; (void)stopTime;
    ((Instance *)c)->now.time = startTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    ((Instance *)c)->now.mode = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    ((Instance *)c)->now.mode = STEP;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    ((Instance *)c)->now.mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    return start((Instance *)c) == 0 ? fmi2OK : fmi2Error;
}

#define GET_INPUT(number, name) case number: value[k] = m->now.in.name; break;
#define GET_OUTPUT(number, name) case number: value[k] = m->now.out.name; break;
#define SET_INPUT(number, name) case number: m->now.in.name = value[k]; break;
#define NOT_SET(number, name)

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Instance *m = (Instance *)c;
    size_t k;
    for (k = 0; k < n; ++k) switch (vr[k]) {
        REALS(GET_INPUT, GET_OUTPUT)
        default: return refuse(m, "there is no real variable %g", (double)vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    Instance *m = (Instance *)c;
    size_t k;
    for (k = 0; k < n; ++k) switch (vr[k]) {
        INTEGERS(GET_INPUT, GET_OUTPUT)
        default: return refuse(m, "there is no integer variable %g", (double)vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    Instance *m = (Instance *)c;
    size_t k;
    for (k = 0; k < n; ++k) switch (vr[k]) {
        BOOLEANS(GET_INPUT, GET_OUTPUT)
        default: return refuse(m, "there is no boolean variable %g", (double)vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)vr; (void)value;
    return n == 0 ? fmi2OK : refuse((Instance *)c, "there are no string variables (%g asked for)", (double)n);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Instance *m = (Instance *)c;
    size_t k;
    for (k = 0; k < n; ++k) switch (vr[k]) {
        REALS(SET_INPUT, NOT_SET)
        default: return refuse(m, "real variable %g is no input", (double)vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    (void)vr; (void)value;
    return n == 0 ? fmi2OK : refuse((Instance *)c, "there are no integer inputs (%g given)", (double)n);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    Instance *m = (Instance *)c;
    size_t k;
    for (k = 0; k < n; ++k) switch (vr[k]) {
        BOOLEANS(SET_INPUT, NOT_SET)
        default: return refuse(m, "boolean variable %g is no input", (double)vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)vr; (void)value;
    return n == 0 ? fmi2OK : refuse((Instance *)c, "there are no string inputs (%g given)", (double)n);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noRewind)
{
    Instance *m = (Instance *)c;
    const double T = CONTROL_PERIOD, off = step > T ? step - T : T - step;
    (void)noRewind;
    if (m->now.mode != STEP) return refuse(m, "a step at %g s: leave the initialization mode first", time);
    if (!(off <= PERIOD_SHARE * T))
        return refuse(m, "a communication step of %g s; it must be the sample time of the controller, as the default "
                         "experiment has it", step);
    m->now.in.period = T;
    CONTROL_STEP(&m->now.state, &m->now.in, &m->now.out);
    m->now.time = time + step;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refuse((Instance *)c, "no step is pending at %g s", ((Instance *)c)->now.time);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state) *state = calloc(1, sizeof(Snapshot));
    if (!*state) return refuse((Instance *)c, "no memory for a state of %g bytes", (double)sizeof(Snapshot));
    *(Snapshot *)*state = ((Instance *)c)->now;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    ((Instance *)c)->now = *(Snapshot *)state;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(Snapshot);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size < sizeof(Snapshot)) return refuse((Instance *)c, "%g bytes are too few for a state", (double)size);
    memcpy(bytes, state, sizeof(Snapshot));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    if (size < sizeof(Snapshot)) return refuse((Instance *)c, "%g bytes are too few for a state", (double)size);
    if (!*state) *state = calloc(1, sizeof(Snapshot));
    if (!*state) return refuse((Instance *)c, "no memory for a state of %g bytes", (double)size);
    memcpy(*state, bytes, sizeof(Snapshot));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t nUnknown,
                                        const fmi2ValueReference known[], size_t nKnown, const fmi2Real dKnown[],
                                        fmi2Real dUnknown[])
{
    (void)unknown; (void)known; (void)nKnown; (void)dKnown; (void)dUnknown;
    return refuse((Instance *)c, "a sampled controller has no derivatives (%g asked for)", (double)nUnknown);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr; (void)order; (void)value;
    return refuse((Instance *)c, "inputs are sampled, without derivatives (%g given)", (double)n);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr; (void)order; (void)value;
    return refuse((Instance *)c, "a sampled controller has no derivatives (%g asked for)", (double)n);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Instance *)c)->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = ((Instance *)c)->now.mode == TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}

"""Controllers made from a parameter file alone, the plants they act on, and one simulation loop that runs both.

    loop                     protocols of controller and plant, replay, Trace; plants with a fault
    sensor_check             validity of a sensor reading
    region/                  AC-2016: the visible region of V and f, its best point, its probability
    recursion/               AC-2017: the best pair minute by minute, to the end of tool life
    constant_load_milling/   CLM-2023: PI on spindle load, feed limits, tool change
    economics/               cost of a part: settings of least cost and greatest rate, change of edges
    roughness/               SURF: constant roughness through constant force
    adaptive_force/          LYAP: adaptive force control, and a fixed PI for comparison

    gate/                    what a control must pass before it is exported
    exports/                 running controls as files: LinuxCNC HAL, structured text

>>> from fitmodels import controllers
>>> controllers.replay.__name__
'replay'
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

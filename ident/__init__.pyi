from .estimators.instrumental import sriv as sriv
from .estimators.least_squares import arx as arx
from .estimators.order_selection import choose_order as choose_order
from .estimators.plant_and_noise import box_jenkins as box_jenkins
from .estimators.prediction_error import armax as armax
from .estimators.prediction_error import output_error as output_error
from .excitation.files import write_excitation as write_excitation
from .excitation.predicted_precision import predicted_errors as predicted_errors
from .excitation.signals import chirp as chirp
from .excitation.signals import multisine as multisine
from .excitation.signals import prbs as prbs
from .excitation.signals import steps as steps
from .identification import identify as identify
from .model import Model as Model
from .physical_models.drive import drive_fit as drive_fit
from .physical_models.force_process import force_process_fit as force_process_fit
from .physical_models.step_response import step_response_fit as step_response_fit
from .pi.gains import PiGains as PiGains
from .pi.published_gains import check_pi as check_pi
from .pi.tuning import tune_pi as tune_pi
from .responses.frequency import frequency_response as frequency_response
from .validation.model_validation import validate as validate

__all__ = [
    "Model",
    "PiGains",
    "armax",
    "arx",
    "box_jenkins",
    "check_pi",
    "chirp",
    "choose_order",
    "drive_fit",
    "force_process_fit",
    "frequency_response",
    "identify",
    "multisine",
    "output_error",
    "prbs",
    "predicted_errors",
    "sriv",
    "step_response_fit",
    "steps",
    "tune_pi",
    "validate",
    "write_excitation",
]

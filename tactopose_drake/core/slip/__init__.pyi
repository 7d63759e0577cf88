from .slip_params import ForceTestParams as ForceTestParams
from .slip_params import RigidityTestParams as RigidityTestParams
from .slip_params import SlipParams as SlipParams

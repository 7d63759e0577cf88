from .demo_run import DemoResult as DemoResult
from .demo_run import GraspFailedError as GraspFailedError
from .demo_run import run_demo as run_demo

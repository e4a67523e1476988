"""Why a run does not learn: what is measured of it, and what the numbers mean."""

from sb3_hucrl.diagnosis.diagnosis import Diagnosis, diagnose
from sb3_hucrl.diagnosis.picture import draw_diagnosis
from sb3_hucrl.diagnosis.report import print_diagnosis
from sb3_hucrl.diagnosis.script import ScriptRun

__all__ = ["Diagnosis", "ScriptRun", "diagnose", "draw_diagnosis", "print_diagnosis"]

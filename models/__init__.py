"""Data of the laboratory: the arm, the body's geometry and the measured table (Scan)."""

from models.arguments import Seed, kinds_checked, path_or, points_of, refuse_other_kind, shortened
from models.arm import ARM_PACKAGE, ARMS, Arm, mesh_folder, read_arm
from models.catalogue import Catalogue
from models.errors import InputError
from models.label_volume import LabelVolume
from models.press_program import (
    USUAL_RADIUS_M,
    PressProgram,
    early_rest,
    grid_program,
    read_program,
    write_program,
)
from models.replaced import replaced
from models.scan import Scan
from models.scan_columns import PHASES, nearest
from models.scan_file import check_scan, read_scan, write_scan
from models.scan_join import join_scans, stack_scans
from models.scan_quality import Doubt, scan_findings, touching, without_outliers
from models.thin import MOST_OF_FREE_MAP, MOST_PRESSES, thinned, well_spread

__all__ = [
    "ARMS",
    "ARM_PACKAGE",
    "MOST_OF_FREE_MAP",
    "MOST_PRESSES",
    "PHASES",
    "USUAL_RADIUS_M",
    "Arm",
    "Catalogue",
    "Doubt",
    "InputError",
    "LabelVolume",
    "PressProgram",
    "Scan",
    "Seed",
    "check_scan",
    "early_rest",
    "grid_program",
    "join_scans",
    "kinds_checked",
    "mesh_folder",
    "nearest",
    "path_or",
    "points_of",
    "read_arm",
    "read_program",
    "read_scan",
    "refuse_other_kind",
    "replaced",
    "scan_findings",
    "shortened",
    "stack_scans",
    "thinned",
    "touching",
    "well_spread",
    "without_outliers",
    "write_program",
    "write_scan",
]

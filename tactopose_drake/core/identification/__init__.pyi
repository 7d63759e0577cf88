from .library_index import SAMPLES as SAMPLES
from .library_index import LibraryIndex as LibraryIndex
from .library_index import PairCounts as PairCounts
from .library_index import PairScoreParams as PairScoreParams
from .library_index import count_pairs as count_pairs
from .model_evidence import log_evidence as log_evidence
from .shape_equality import ShapeEqualityParams as ShapeEqualityParams
from .shape_equality import find_alignment as find_alignment

"""Words of the verdict on a part, as reports, archive and messages have them."""

IN_TOLERANCE, OUT_OF_TOLERANCE = 'in tolerance', 'out of tolerance'  # finish as-laid
CLEANS_UP, DOES_NOT_CLEAN_UP = 'cleans up', 'does not clean up'  # finish machined
NOT_JUDGED, FAILED = 'not judged', 'failed'
GOOD = (IN_TOLERANCE, CLEANS_UP)
REJECTED = (OUT_OF_TOLERANCE, DOES_NOT_CLEAN_UP)

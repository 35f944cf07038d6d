"""The case: everything that a result depends on, as frozen values in mm, mN and kPa.

The names that this room gives out are listed in `__init__.pyi`. Each is imported when it is first used, so that a run, which needs
the tables alone, does not depend on reading, wording and writing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

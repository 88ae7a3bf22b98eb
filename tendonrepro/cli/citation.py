"""How to cite the paper, its dataset and this software."""

from __future__ import annotations

from tendonrepro import __version__

_ENTRIES = """\
@article{{yan2026kinematic,
  author  = {{Yan, Fei and Li, Jianhua and Han, Huawei and Xu, Qiwang and Hu, Linfeng}},
  title   = {{Kinematic Decoupling and {{$\\alpha$}}-{{TDE}}-{{NTSM}} Control
             for Single-Tendon-Driven Manipulators}},
  journal = {{Actuators}},
  year    = {{2026}},
  volume  = {{15}},
  number  = {{5}},
  pages   = {{271}},
  doi     = {{10.3390/act15050271}}
}}

@dataset{{yan2026data,
  author    = {{Yan, Fei and Li, Jianhua and Han, Huawei and Xu, Qiwang and Hu, Linfeng}},
  title     = {{Dataset of Kinematic Decoupling and {{$\\alpha$}}-{{TDE}}-{{NTSM}} Control
               for Single-Tendon-Driven Manipulators}},
  year      = {{2026}},
  publisher = {{Zenodo}},
  note      = {{record 19467931}}
}}

@software{{tendonrepro,
  author  = {{{{The tendonrepro developers}}}},
  title   = {{tendonrepro: a reproduction of Yan et al. (2026)}},
  year    = {{2026}},
  version = {{{version}}}
}}"""


def bibtex() -> str:
    """BibTeX entries of paper, dataset and software."""
    return _ENTRIES.format(version=__version__)

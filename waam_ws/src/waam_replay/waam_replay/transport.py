"""Settings of the middleware for a lock-step replay.

A reliable writer learns what its readers have when it asks them, by default every 3 s; waiting for that after every
handful of messages takes 3 s each time. The player asks every few milliseconds instead. Nothing else of the profiles
that are in force is changed.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
NAMESPACE = 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'
PERIOD_NS = 5_000_000


def quick_profiles(given: str) -> str:
    """The profiles in the text `given` (empty: none) with a short heartbeat period of every writer.

    ValueError when it is no XML of profiles.
    """
    ElementTree.register_namespace('', NAMESPACE)
    try:
        root = ElementTree.fromstring(given) if given else ElementTree.Element(_tag('dds'))
    except ElementTree.ParseError as e:
        raise ValueError(f'profiles of the middleware ({VARIABLE}): {e}') from e
    profiles = root if root.tag == _tag('profiles') else _child(root, 'profiles')
    writer = profiles.find(f'{_tag("data_writer")}[@is_default_profile="true"]')
    if writer is None:
        attributes = {'profile_name': 'lockstep', 'is_default_profile': 'true'}
        writer = ElementTree.SubElement(profiles, _tag('data_writer'), attributes)
    period = _child(_child(writer, 'times'), 'heartbeatPeriod')
    for name, value in (('sec', 0), ('nanosec', PERIOD_NS)):
        _child(period, name).text = str(value)
    return ElementTree.tostring(root, encoding='unicode')


def quick_environment(environment: dict[str, str], scratch: Path) -> dict[str, str]:
    """What to add to `environment`; the profiles are written to the folder `scratch`."""
    given = environment.get(VARIABLE, '')
    text = quick_profiles(Path(given).read_text(encoding='utf-8') if given else '')
    file = scratch / 'lockstep.xml'
    file.write_text(text, encoding='utf-8')
    return {VARIABLE: str(file)}


def _tag(name: str) -> str:
    return f'{{{NAMESPACE}}}{name}'


def _child(parent: ElementTree.Element, name: str) -> ElementTree.Element:
    found = parent.find(_tag(name))
    return ElementTree.SubElement(parent, _tag(name)) if found is None else found

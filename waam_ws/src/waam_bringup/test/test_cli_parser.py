"""What the command line says when it is asked, and when a word of it is wrong."""

from __future__ import annotations

import json
import math
import subprocess

import pytest

from waam_bringup.cli import build_parser, main
from waam_bringup.cli_parser import GROUPS


@pytest.mark.parametrize(
    ('line', 'usage', 'said'),
    [
        (['jbo'], 'usage: waam [', "'jbo' is none; did you mean 'job'?"),
        (['qqqq'], 'usage: waam [', "'qqqq' is none; known are up, stop,"),
        (['job', 'rnu'], 'usage: waam job [', "'rnu' is none; did you mean 'run'?"),
        (['plan', 'a.stl', '--strateg', 'zigzg'], 'usage: waam plan [', "did you mean 'zigzag'?"),
        (['job', 'run', 'a.stl', '--as-fuond', 'b.stl'], 'usage: waam job run [', "did you mean '--as-found'?"),
        (['status', 'now'], 'usage: waam status [', 'unrecognized arguments: now\n'),
    ],
)  # fmt: skip
def test_what_is_misspelt_gets_the_usage_of_its_verb_and_the_nearest_name(
    line, usage, said, capsys
):
    with pytest.raises(SystemExit) as ended:
        main(line)
    told = capsys.readouterr()
    assert ended.value.code == 2 and not told.out
    assert told.err.startswith(usage) and said in told.err


def test_every_verb_is_in_one_group_and_every_group_has_verbs(capsys):
    verbs = next(a for a in build_parser()._actions if a.dest == 'command').choices
    assert sorted(sum(GROUPS.values(), ())) == sorted(verbs)
    with pytest.raises(SystemExit):
        main(['--help'])
    text = capsys.readouterr().out
    assert all(f'\n  {title}:\n' in text for title in GROUPS) and 'more:' not in text


def test_bash_completes_verbs_options_and_choices(capsys):
    assert main(['completion', 'bash']) == 0
    script = capsys.readouterr().out
    for words, wanted in (
        ('waam jo', {'job', 'jobs'}), ('waam job re', {'resume', 'rescan'}),
        ('waam job run --as-f', {'--as-found'}), ('waam plan --strategy zi', {'zigzag'}),
    ):  # fmt: skip
        ask = f'COMP_WORDS=({words}); COMP_CWORD={len(words.split()) - 1}; _shtab_waam; echo "${{COMPREPLY[@]}}"'
        ran = subprocess.run(
            ['bash', '-c', f'{script}\n{ask}'], capture_output=True, text=True, check=True
        )
        assert set(ran.stdout.split()) == wanted, words


def test_a_message_as_json_says_null_for_what_is_unknown():
    from waam_bringup.status import plain
    from waam_msgs.msg import JobStatus, MachineState

    job = plain(JobStatus(job_id='a', layer=3, time_left=math.nan, height_error_rms=0.5))
    assert (job['job_id'], job['layer'], job['time_left'], job['height_error_rms']) == (
        'a',
        3,
        None,
        0.5,
    )
    machine = plain(MachineState(connected=True, capabilities=['a', 'b']))
    assert machine['work_offset'] == {'x': 0.0, 'y': 0.0, 'z': 0.0} and machine['capabilities'] == [
        'a',
        'b',
    ]
    assert 'header' not in machine and json.loads(json.dumps(machine)) == machine

"""What a recording says of its job."""

import hashlib

from waam_record.provenance import job_files


def test_a_record_in_the_folder_of_a_job_knows_the_job(tmp_path):
    assert job_files(tmp_path / 'record') == {}
    (tmp_path / 'job.yaml').write_text('part_sha256: 12\n')
    (tmp_path / 'program.gcode').write_bytes(b'G21\n')
    found = job_files(tmp_path / 'record')
    assert found['job.yaml'] == 'part_sha256: 12\n'
    assert found['sha256.program.gcode'] == hashlib.sha256(b'G21\n').hexdigest()
    assert found['sha256.job.yaml'] == hashlib.sha256(b'part_sha256: 12\n').hexdigest()

"""The commands of docs/remote_actions.md, from an action server of one's own to models, gate and demo."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from documentation import ROOT

BIN = Path(get_package_prefix("ator_ros"), "lib", "ator_ros")
PAGE = (ROOT / "docs" / "remote_actions.md").read_text(encoding="utf-8")
OTHER = {  # what another server has in place of the printed one
    "shuttle_msgs/action/Go": "ator_interfaces/action/DriveTo",
    "field: target": "field: goal",
    "field: arrived, equals: true": "field: error_code, equals: 0",
    "reason: text": "reason: error_msg",
    "server: go": "server: drive_to",
    "[python3, src/shuttle/shuttle/server.py]": "python3 -m ator_ros.examples.drive_to_server",
}


@pytest.mark.node
@pytest.mark.long
def test_own_server_is_driven_learned_and_refined(tmp_path: Path) -> None:
    (text,) = re.findall(r"^```yaml\n(name: shuttle\n.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    for printed, other in OTHER.items():
        assert printed in text
        text = text.replace(printed, other)
    (tmp_path / "my_domain.yaml").write_text(text, encoding="utf-8")
    printed_words = dict(re.findall(r"make run EXE=(\w+) ARGS='(.*~/ws/my_domain.yaml.*)'", PAGE))
    small = {"collect": "--episodes 42 --seed 3", "train": "", "demo": "--situations 1 --out demo.png"}
    said = {}
    for tool, more in small.items():
        words = f"{printed_words[tool].replace('~/ws/', '')} {more}".split()
        ended = subprocess.run(
            [str(BIN / tool), *words], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False
        )
        assert ended.returncode == 0, ended.stdout + ended.stderr
        said[tool] = ended.stdout
    assert "my_models/gate.json: refines where the predicted gain is above" in said["train"]
    assert "three nodes, python3 -m ator_ros.examples.drive_to_server start" in said["demo"]
    assert "1 of 1 situations succeeded both ways" in said["demo"]

"""All packages are locked to one version, with hashes."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_every_package_is_locked_with_hashes() -> None:
    lines = (ROOT / "requirements" / "constraints.txt").read_text(encoding="utf-8").splitlines()[1:]
    pins = [line for line in lines if not line.startswith("    --hash=sha256:")]
    assert all("==" in pin and pin.endswith(" \\") for pin in pins)
    assert "://" not in "".join(line for line in lines)
    locked = {pin.split("==")[0]: pin.split("==")[1].split()[0] for pin in pins}
    for name in ("ros", "build", "runtime", "offline", "view", "test", "lint"):
        for line in (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").splitlines():
            if "==" in line and not line.startswith("#"):
                package, version = line.strip().split("==")
                assert locked[package.split("[")[0].lower()] == version

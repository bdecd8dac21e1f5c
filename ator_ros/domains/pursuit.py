"""The domain `pursuit`: what config/pursuit/pursuit.yaml declares."""

from __future__ import annotations

from ator_ros.domains.domain import declared_domain
from ator_ros.resources import resource_path

PURSUIT = declared_domain(resource_path("config", "pursuit", "pursuit.yaml"))

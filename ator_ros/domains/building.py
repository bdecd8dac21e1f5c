"""The domain `building`: tours of stations in five rooms, as a YAML file declares it. It loads a map."""

from __future__ import annotations

from ator_ros.domains.domain import declared_domain
from ator_ros.resources import resource_path

BUILDING = declared_domain(resource_path("config", "building", "building.yaml"))

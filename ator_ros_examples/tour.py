"""The domains of the two example servers, as YAML files declare them; `building` is on a map."""

from __future__ import annotations

from ator_ros.domains.domain import declared_domain
from ator_ros.resources import resource_path

TOUR = declared_domain(resource_path("config", "tour", "tour.yaml"))
PURSUIT = declared_domain(resource_path("config", "pursuit", "pursuit.yaml"))
PATROL = declared_domain(resource_path("config", "patrol", "patrol.yaml"))
BUILDING = declared_domain(resource_path("config", "building", "building.yaml"))

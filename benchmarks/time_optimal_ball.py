#!/usr/bin/env python3
"""Time-optimal motions with the ball: approach, dribble, and the chain of both of a differential drive.

    time_optimal_ball.py KIND SITUATIONS.json [--count N] [--ignore-body]

KIND is approach, dribble or chain. SITUATIONS.json is a list of [start, goal], the poses of the axle, or for chain of
[start, ball position, goal], in m and rad; starts and goals at rest. An approach ends with the ball at the hold; a chain
does not stop at the ball, and chooses the heading there. Printed: a JSON list of times in s (null: not solved).

Approach: forward or reverse, at the base's limits; unless --ignore-body the ball stays outside an ellipse round the body until
the last tenth, and the robot does not turn as it takes the ball. Dribble: forward only, within the dribbling limits, and the
front always presses on the ball: acceleration - hold * w^2 + roll * v / |ball's speed| >= -0.03 m/s^2. A transcription of 45
intervals a leg, solved from seven to fourteen guesses: a local optimum, so an upper bound on the true minimum. Needs casadi and numpy.
"""
import argparse
import json
import math
import sys

import casadi as ca
import numpy as np

HOLD = 0.31                       # m from axle to the center of a held ball
ROLL = 0.7                        # m/s^2, what rolling costs the ball
DRIVE = {"v": 1.2, "w": 2.4, "a": 0.8, "brake": 0.8, "aw": 4.0}
DRIBBLE = {"v": 1.0, "w": 1.2, "a": 0.8, "brake": 0.5, "aw": 3.0}
BODY = (0.46, 0.33)               # m, half axes of the ellipse that the ball's center stays out of
NODES = 45


def wrap(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


LEGS = {"approach": (False,), "dribble": (True,), "chain": (False, True)}   # whether each leg dribbles


def build(kind, avoid):
    """One solver for all situations of a kind; the parameters are start (3), ball (2) and goal (3)."""
    opti = ca.Opti()
    start, ball, goal = opti.parameter(3), opti.parameter(2), opti.parameter(3)
    legs, total, before = [], 0, None
    for dribbling in LEGS[kind]:
        limits = DRIBBLE if dribbling else DRIVE
        x, u, t = opti.variable(5, NODES + 1), opti.variable(2, NODES), opti.variable()
        opti.subject_to(opti.bounded(0.05, t, 60))
        h = t / NODES
        for k in range(NODES):
            heading = x[2, k] + h / 2 * x[4, k] + h * h / 8 * u[1, k]
            speed = x[3, k] + h / 2 * u[0, k]
            opti.subject_to(x[0, k + 1] == x[0, k] + h / 6 * (x[3, k] * ca.cos(x[2, k]) + 4 * speed * ca.cos(heading) + x[3, k + 1] * ca.cos(x[2, k + 1])))
            opti.subject_to(x[1, k + 1] == x[1, k] + h / 6 * (x[3, k] * ca.sin(x[2, k]) + 4 * speed * ca.sin(heading) + x[3, k + 1] * ca.sin(x[2, k + 1])))
            opti.subject_to(x[2, k + 1] == x[2, k] + h / 2 * (x[4, k] + x[4, k + 1]))
            opti.subject_to(x[3, k + 1] == x[3, k] + h * u[0, k])
            opti.subject_to(x[4, k + 1] == x[4, k] + h * u[1, k])
        opti.subject_to(opti.bounded(0 if dribbling else -limits["v"], x[3, :], limits["v"]))
        opti.subject_to(opti.bounded(-limits["w"], x[4, :], limits["w"]))
        opti.subject_to(opti.bounded(-limits["brake"], u[0, :], limits["a"]))
        opti.subject_to(opti.bounded(-limits["aw"], u[1, :], limits["aw"]))
        if dribbling:
            v, w = x[3, :NODES], x[4, :NODES]
            opti.subject_to(u[0, :] - HOLD * w * w + ROLL * v / ca.sqrt(v * v + HOLD * HOLD * w * w + 1e-3) >= -0.03)
        else:
            if kind == "chain":
                opti.subject_to(x[0, -1] + HOLD * ca.cos(x[2, -1]) == ball[0])
                opti.subject_to(x[1, -1] + HOLD * ca.sin(x[2, -1]) == ball[1])
            if avoid:
                if kind == "chain":
                    opti.subject_to(x[4, -1] == 0)
                for k in range(NODES - 6):
                    dx, dy = ball[0] - x[0, k], ball[1] - x[1, k]
                    ahead = dx * ca.cos(x[2, k]) + dy * ca.sin(x[2, k])
                    aside = -dx * ca.sin(x[2, k]) + dy * ca.cos(x[2, k])
                    opti.subject_to((ahead / BODY[0]) ** 2 + (aside / BODY[1]) ** 2 >= 1)
        if before is None:
            opti.subject_to(x[:3, 0] == start)
            opti.subject_to(x[3:, 0] == 0)
        else:
            opti.subject_to(x[:, 0] == before)
        before, total = x[:, -1], total + t
        legs.append((x, u, t))
    opti.subject_to(before[:2] == goal[:2])
    opti.subject_to(ca.sin((before[2] - goal[2]) / 2) == 0)
    opti.subject_to(before[3:] == 0)
    opti.minimize(total)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "max_iter": 500, "tol": 1e-5, "sb": "yes"})
    return opti, start, ball, goal, legs, total


def guess(p, q, limits, bulge, reverse):
    """A bulged path from pose p to pose q as a first guess."""
    s = np.linspace(0, 1, NODES + 1)
    d = np.array(q[:2]) - np.array(p[:2])
    xy = np.outer(1 - s, p[:2]) + np.outer(s, q[:2]) + np.outer(4 * s * (1 - s) * bulge, [-d[1], d[0]])
    tangent = np.unwrap(np.arctan2(*np.gradient(xy, axis=0).T[::-1])) + (math.pi if reverse else 0)
    heading = p[2] + wrap(tangent[0] - p[2]) + tangent - tangent[0]
    heading[0] = p[2]
    length = np.sum(np.linalg.norm(np.diff(xy, axis=0), axis=1))
    t = length / limits["v"] + 2.5
    v = (-1 if reverse else 1) * length / t * np.ones(NODES + 1)
    return np.vstack([xy.T, heading, v, np.zeros(NODES + 1)]), t


def guesses(kind, start, ball, goal):
    """First guesses of all legs, each a path and its time."""
    for reverse in (False, True)[: 1 if kind == "dribble" else 2]:
        if kind != "chain":
            limits = DRIBBLE if kind == "dribble" else DRIVE
            for bulge in (0.0, 0.3, -0.3, 0.7, -0.7, 1.2, -1.2):
                yield [guess(start, goal, limits, bulge, reverse)]
            continue
        for heading in np.arange(0, 2 * math.pi, math.pi / 3):
            at_ball = [ball[0] - HOLD * math.cos(heading), ball[1] - HOLD * math.sin(heading), heading]
            first, t_first = guess(start, at_ball, DRIVE, 0.3 if heading % 2 < 1 else -0.3, reverse)
            there = list(first[:3, -1])
            there[2] += wrap(heading - there[2])
            yield [(first, t_first), guess(there, goal, DRIBBLE, 0.4 if heading > math.pi else -0.4, False)]


def solve(kind, problem, start, *between, goal):
    opti, p_start, p_ball, p_goal, legs, total = problem
    ball = between[0] if between else [goal[0] + HOLD * math.cos(goal[2]), goal[1] + HOLD * math.sin(goal[2])]
    for parameter, value in ((p_start, start), (p_ball, ball), (p_goal, goal)):
        opti.set_value(parameter, value)
    best = math.inf
    for paths in guesses(kind, start, ball, goal):
        for (x, u, t), (path, time) in zip(legs, paths):
            opti.set_initial(x, path)
            opti.set_initial(u, 0)
            opti.set_initial(t, time)
        try:
            best = min(best, float(opti.solve().value(total)))
        except RuntimeError:
            continue
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=LEGS)
    parser.add_argument("situations")
    parser.add_argument("--count", type=int)
    parser.add_argument("--ignore-body", action="store_true")
    args = parser.parse_args()
    with open(args.situations) as file:
        situations = json.load(file)[: args.count]
    problem, times = build(args.kind, not args.ignore_body), []
    for *before, goal in situations:
        times.append(solve(args.kind, problem, *before, goal=goal))
        print(f"{len(times)} of {len(situations)}: {times[-1]:.3f} s", file=sys.stderr)
    print(json.dumps([round(t, 4) if math.isfinite(t) else None for t in times]))


if __name__ == "__main__":
    main()

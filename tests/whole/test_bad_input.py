"""Bad input of every command and option: one line that names it and status 2, before anything is computed or written.

A line of the tables is what stands behind `whiptool`, then what the answer must hold. What is accepted although it
looks odd stands in `ACCEPTED`, with its reason.
"""

from __future__ import annotations

import dataclasses
import io
import os
import shlex
import signal
import subprocess
import sys
import zipfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from processes import HANG

from whiptool.commands import cli, run_folders
from whiptool.commands.options.option_group import OptionGroup
from whiptool.errors import InputError
from whiptool.models import preset, write_model
from whiptool.models.files import model_to_table
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.whole_files import write_whole

STRIKE = "-0.6 0.2 0.7 2.1 1.2"  # a good one
OPTIONS = {
    "optimize": ("whiptool.commands.optimize", "OptimizeOptions"),
    "simulate": ("whiptool.commands.simulate", "SimulateOptions"),
    "train": ("whiptool.commands.train", "TrainOptions"),
    "map-build": ("whiptool.commands.map", "BuildOptions"),
    "map-strike": ("whiptool.commands.map", "MapStrikeOptions"),
    "compare": ("whiptool.commands.compare", "CompareOptions"),
    "reproduce": ("papers.reproduce", "ReproduceOptions"),
    "adapt": ("whiptool.commands.adapt", "AdaptOptions"),
    "human": ("papers.human.command", "HumanOptions"),
    "adapt-next": ("whiptool.commands.adapt", "NextOptions"),
    "identify": ("whiptool.commands.identify", "IdentifyOptions"),
    "view": ("whiptool.commands.view", "ViewOptions"),
    "recording-show": ("whiptool.commands.recording", "ShowOptions"),
    "recording-convert": ("whiptool.commands.recording", "ConvertOptions"),
    "studio": ("whiptool.commands.studio", "StudioOptions"),
    "doctor": ("whiptool.commands.doctor", "DoctorOptions"),
    "strike": ("whiptool.commands.rig", "RigStrikeOptions"),
    "learn": ("whiptool.commands.rig", "LearnOptions"),
    "servos": ("whiptool.commands.servos", "ServoOptions"),
    "emulator": ("whiptool.commands.emulators", "EmulatorOptions"),
    "ur_emulator": ("whiptool.commands.emulators", "UrEmulatorOptions"),
}
NEEDS = {
    "strike": f"--strike {STRIKE}",
    "servos": "--port /dev/nowhere",
    "identify": "good.npz",
    "recording-show": "good.npz",
    "recording-convert": "good.npz new.csv",
    "view": "of-simulate",
    "map-strike": "of-simulate",
    "adapt-next": "--run of-simulate",
    "simulate": f"--strike {STRIKE}",
}

# how many coordinates a target has is known once the map is read; a motor alone limits adapt; reproduce knows one space
ELSEWHERE = [("map-strike", "--target 1 2 3"), ("adapt", "--limits xm540")]
ELSEWHERE += [("reproduce", f"--space {x}") for x in ("tool", "pose", "hand --feedforward")]
ELSEWHERE += [("map-strike", "--out NAME"), ("human", "--out NAME")]
ELSEWHERE += [("reproduce", "--space hand --controller constant --preset nah2020")]

# Of every command that has the option: what is given, and what the answer must hold
SHARED = """
--target nan 0 | target
--target inf 0 | target
--target 1 | target
--target 1 2 3 | target
--target | --target
--target a b | --target
--hit-radius 0 | --hit-radius
--hit-radius -1 | --hit-radius
--hit-radius nan | --hit-radius
--hit-radius 1e400 | --hit-radius
--t-stay -1 | --t-stay
--t-stay nan | --t-stay
--t-stay 1e9 | --t-stay
--controller pid | constant, oiac
--controller "" | --controller
--preset table5 | printed, table4
--preset "" | preset
--controller constant --preset printed | --preset
--torque-limit 0 | --torque-limit
--torque-limit -inf | --torque-limit
--control-period 0 | --control-period
--control-period 10 | --control-period
--control-period nan | --control-period
--space tool | joint, hand, pose
--space pose | 3 joints or more, for the hand's position and orientation
--space hand --turn-stiffness 3 | only with --space pose
--space hand --turn-damping 3 | only with --space pose
--space pose --controller constant --turn-damping -1 | --turn-damping
--turn-stiffness 3 | only with --space pose
--space hand --home 0.1 | posture: got
--space hand --home nan 1 | --home
--space hand --home 0.3 0 | not a singular
--space hand --feedforward | --feedforward
--space hand --null-damping -1 | --null-damping
--space hand --controller constant --preset nah2020 | --preset
--space hand --stiffness 100 | only with --controller constant
--space hand --controller constant --damping nan | --damping
--home 0.3 1 | only with --space hand
--null-damping 2 | only with --space hand
--stiffness 100 | only with --space hand
--damping 100 | only with --space hand
--timestep 0 | --timestep
--timestep 1e-300 | --timestep
--timestep 1 | --timestep
--timestep nan | --timestep
--tolerance 0 | --tolerance
--tolerance nan | --tolerance
--tolerance 1e-4 --timestep 1e-3 | only without --timestep
--simulator reference --tolerance 1e-4 | only without --simulator reference
--whip-length 0 | --whip-length
--whip-length nan | --whip-length
--nodes 0 | --nodes
--taper -1 | --taper
--youngs-modulus 0 --diameter 0.01 --density 700 | --youngs-modulus
--youngs-modulus 1e6 --diameter 0 --density 700 | --diameter
--youngs-modulus 1e6 --diameter 0.01 --density nan | --density
--youngs-modulus 1e6 --density 700 | go together
--simulator gazebo | compiled, reference
--integrator RK4 | --integrator
--simulator reference --integrator RK5 | RK4, Euler
--zone-radius 0 | --zone-radius
--zone-radius nan | --zone-radius
--seed -1 | --seed
--seed 99999999999999999999 | --seed
--seed 1.5 | --seed
--starts 0 | --starts
--limits xm540 | arm, none
--keep-free 1 | --keep-free
--keep-free -0.1 | --keep-free
--keep-free nan | --keep-free
--floor nan | --floor
--floor inf | --floor
--floor high | a number [m], or none
--clearance -0.01 | --clearance
--clearance nan | --clearance
--speed-limits elbow | --speed-limits
--speed-limits nose=1 | --speed-limits
--limits none --keep-free 0.1 | only without --limits none
--limits none --floor -1 | only without --limits none
--limits none --ignore-collisions | only without --limits none
--ignore-collisions --floor -1 | only without --ignore-collisions
--ignore-collisions --clearance 0.1 | only without --ignore-collisions
--rate 1 | --rate
--rate 1e9 | --rate
--rate nan | --rate
--approach-speed 1e6 | --approach-speed
--approach-speed 0 | --approach-speed
--approach-speed 1e-9 | --approach-speed
--settle -1 | --settle
--settle inf | --settle
--latency -1 | --latency
--latency 5 | --latency
--targets 0 | --targets
--targets 1000000000000 | --targets
--target-seed -1 | --target-seed
--seeds 0 | --seeds
--tighter 0.07 | --tighter
--tighter 0.03 0.03 | --tighter
--tighter nan | --tighter
--trials 1 | --trials
--episodes 0 | --episodes
--further-episodes 0 | --further-episodes
--workers 2 --cluster auto | --workers
--random-episodes -1 | --random-episodes
--hindsight -1 | --hindsight
--true-model absent.toml | absent.toml
--seed 1 --seed 2 | twice
--target 1e308 0 | target
--target HUGE 0 | target
--hit-radius 1e-310 | --hit-radius
--zone-radius 1e-310 | --zone-radius
--seed HUGE | --seed
--t-stay HUGE | --t-stay
--out LONG | at most 4000 characters
--out DEEP | at most 200 folders
--out NAME | --out
--json --no-json | twice
--frobnicate | --frobnicate
--model | --model
--arm | --arm
--arm absent.toml | absent.toml
--arm-tip | --arm-tip
--mount | --mount
"""

# Of single commands
OWN = """
optimize --method | --method
optimize --method magic | directl, gradient
optimize --method nlopt:MAGIC | nlopt:
optimize --method gradient --simulator reference | --method
optimize --max-trials 0 | --max-trials
optimize --max-trials many | --max-trials
optimize --max-trials 1e3 | --max-trials
optimize --max-time 0 | --max-time
optimize --max-time nan | --max-time
optimize --lower 0 0 0 0 1 --upper 1 1 1 1 0.5 | lower < upper
optimize --lower 0 0 0 0 nan --upper 1 1 1 1 2 | --lower, number 5: got nan; allowed: a finite number
optimize --lower 0 0 | --lower
optimize --space hand --controller hand.toml | [controller.hand] into the file
optimize --controller magic.toml | controller.hand.magic
train --controller hand.toml | without a table [controller.hand]
compare --controller hand.toml | without a table [controller.hand]
optimize --space hand --lower 0 0 | 5 numbers, x_i y_i x_f y_f D
simulate --model ur5e --space pose --turn-stiffness 9 --controller position | only with --controller constant
simulate --model ur5e --space pose --controller position --strike 0 0 0 1 1 1 1 | x_i y_i z_i turn_x_i turn_y_i turn_z_i
simulate --space hand --strike 0.3 0 0.4 | 5 numbers, x_i y_i x_f y_f D
simulate --space hand --strike 0.4 0 2 0 0.5 | a start and an end that the hand reaches
simulate --space hand --strike 0.4 0 0 0.4 -1 | D: got -1.0; allowed: a finite number > 0
optimize --upper 0 0 0 0 0 0 0 | --upper
optimize --throw | --box with the opening's centre and width
optimize --box 1.8 0 0.2 | only with --throw
optimize --throw --box 1.8 0 | X Y SIZE, or in space X Y Z SIZE
optimize --throw --box 1.8 0 0.03 | an opening wider than the thing
optimize --throw --box 1.8 0 nan | --box
optimize --throw --box 1.8 0 0 0.2 | --box: got (1.8, 0.0, 0.0, 0.2); allowed: X Y SIZE in m
optimize --throw --box 1.8 0 0.2 --box-normal 1 0 | degrees from straight up
optimize --throw --box 1.8 0 0.2 --box-velocity 1 | --box-velocity
optimize --throw --box 1.8 0 0.2 --least-speed 3 --most-speed 2 | --most-speed
optimize --throw --box 1.8 0 0.2 --thing-mass 0 | --thing-mass
optimize --throw --box 1.8 0 0.2 --thing-diameter -1 | --thing-diameter
optimize --throw --box 1.8 0 0.2 --release-from elbow | --release-from
optimize --throw --box 1.8 0 0.2 --release-time -1 | --release-time
optimize --throw --box 1.8 0 0.2 --release-time 99 | --release-time: got 99.0; allowed: from 0 to 1.8 s
optimize --throw --box 1.8 0 0.2 --direction 0 1 | one that leads into the opening
optimize --throw --box 1.8 0 0.2 --box-velocity 50 0 | at most 10 m/s
optimize --throw --box 1.8 0 0.4 --thing-mass 0.00005 --thing-diameter 0.2 | --thing-mass and --thing-diameter
optimize --throw --box 1.8 0 0.2 --release-noise 3 | --release-noise
optimize --throw --box 1.8 0 0.2 --target 1 0 | without --throw
optimize --throw --box 1.8 0 0.2 --method map | maps are of strikes
optimize --stop-at-hit 3 | command line
optimize --video yes | command line
train --video yes | command line
optimize stray | command line
optimize --target 3 0 | reach of
optimize --hit-radius 100 | --hit-radius: got 100
optimize --direction 0 0 | a vector that is not zero
optimize --direction 1 0 0 | 2 finite numbers
optimize --direction 1 0 --arrival-angle 30 | --arrival-angle
optimize --direction 1 0 --cone 0 | --cone
optimize --arrival-angle nan | arrival
optimize --least-speed 0 | --least-speed
optimize --cone 20 | only with --direction
optimize --keep-free 0.1 | 0 for an arm without limits
optimize --clearance 0.1 | 0 for an arm with neither capsules
optimize --rest 1 | only with --export-trajectory
optimize --joint-prefix left_ | only with --export-trajectory
optimize --export-trajectory strike.txt | .csv
optimize --export-trajectory strike.csv --trajectory-rate 0 | --trajectory-rate
optimize --export-trajectory strike.csv --posture 1 | 2 numbers
optimize --export-trajectory strike.csv --posture nan 0 | --posture
optimize --model lemon2025 | lemon2024, nah2020-n10
optimize --model "" | model
optimize --model absent.toml | --model: got 'absent.toml'; allowed: a readable TOML
optimize --model päitsche.toml | päitsche.toml
optimize --model folder.toml | folder.toml
optimize --model empty.toml | whip
optimize --model broken.toml | valid TOML
optimize --model gibberish.toml | valid TOML
optimize --model utf16.toml | whip
optimize --model zero.toml | whip.N
optimize --model negative.toml | whip.m
optimize --model infinite.toml | whip.m
optimize --model heavy.toml | magnitude
optimize --model text.toml | whip.m
optimize --model list.toml | whip
optimize --model many.toml | whip.m
optimize --model huge.toml | whip.m
optimize --model huge-n.toml | whip.N
optimize --model digits.toml | valid TOML
optimize --model tiny-mass.toml | whip.m: got 1e-310
optimize --model tiny-length.toml | whip.l: got 1e-310
optimize --model tiny-link.toml | mass: got 1e-310
optimize --model far.toml | lengths are in m
optimize --model name-in-lines.toml | name
optimize --model arrays.toml | nested
optimize --model dots.toml | at most 50 parts
optimize --model pipe.toml | not a pipe or a device
optimize --model device.toml | not a pipe or a device
optimize --model pipe.urdf | not a pipe or a device
optimize --model pipe.xml | not a pipe or a device
optimize --model of-pipe.toml | not a pipe or a device
optimize --model includes.xml | not a pipe or a device
optimize --model replicate.xml | replicas
optimize --model deep.urdf | nested elements
optimize --model deep.xml | nested elements
optimize --model entities.urdf | entities
optimize --controller pipe.toml | pipe.toml
optimize --controller huge-gain.toml | K
optimize --controller law-list.toml | controller.law
optimize --lower 1e308 0 0 0 1 --upper 1 1 1 1 2 | --lower, number 1: got 1e+308
optimize --lower HUGE 0 0 0 1 --upper 1 1 1 1 2 | --lower, number 1
optimize --max-trials HUGE | --max-trials
optimize --resume NAME | NAME
simulate --strike 1e308 0 0 0 1 | strike vector: got (1e+308
simulate --strike HUGE 0 0 0 1 | strike vector
simulate --strike 0 0 0 0 1e-310 | D
simulate --strike 1e6 0 0 0 1 | are these degrees?
simulate --strike -78 27 99 81 0.95 | are these degrees?
optimize --lower -78 27 99 81 0.4 --upper -70 30 100 90 1 | are these degrees?
simulate --strike 0 0 0 0 1 --export-trajectory absent/strike.csv | is not an existing folder
simulate --export NAME.xml | --export
strike --strike 1e308 0 0 0 1 | strike vector
train --region pipe.npz | not a pipe or a device
train --region pickled.npz | pickled
train --region petabyte.npz | the shape
adapt --known pipe.npz | pipe.npz
adapt --known pickled.npz | pickled
adapt --prior pipe.toml | not a pipe or a device
adapt --prior huge-prior.toml | whip
identify pipe.npz | not a pipe or a device
identify pipe.csv | not a pipe or a device
identify pickled.npz | pickled
identify petabyte.npz | the shape
identify --prior pipe.toml | not a pipe or a device
identify --tip pipe.toml | not a pipe or a device
view pickled-run | pickled
view empty-run | empty
view of-no-model | model: got 3
view of-option-list | options: got [1]
map-strike of-option-list | whiptool map
optimize --resume of-path-list | --resume
view foreign-run | the keys t
view NAME | NAME
optimize --model three.toml --controller constant | one per arm joint
optimize --model three.toml | --lower and --upper
optimize --out taken | new or empty
optimize --out file | --out
optimize --out /proc/nowhere | can be written
optimize --out /dev/full | --out
optimize --out "" | --out
optimize --resume taken | --resume
optimize --resume absent | --resume
optimize --resume file | --resume
optimize --resume of-simulate | --resume
optimize --resume of-garbage | TOML
optimize --resume of-nothing | --resume
optimize --resume of-others | --resume
simulate --export | --export
simulate --export x.xml --no-video | --video
simulate --strike 1 2 | strike
simulate --strike nan 0 0 0 1 | a vector of finite numbers
simulate --strike 0 0 inf 0 1 | a vector of finite numbers
simulate --strike 0 0 0 0 0 | D
simulate --strike 0 0 0 0 -1 | D
simulate --strike 0 0 0 0 1e9 | timestep
simulate --strike a b c d e | --strike
simulate --strike 0 0 0 0 0 0 1 | 5 numbers
simulate --hit-radius 100 | --hit-radius: got 100
simulate --strike 0 0 0 0 1 --direction 0 0 | a vector that is not zero
simulate --strike 0 0 0 0 1 --arrival-angle 30 --cone 181 | --cone
simulate --strike 0 0 0 0 1 --least-speed -1 | --least-speed
simulate --strike 0 0 0 0 1 --export-trajectory strike.csv --rest -1 | --rest
simulate --strike 0 0 0 0 1 --joint-prefix left_ | only with --export-trajectory
simulate --strike 0 0 0 0 1 --export-trajectory strike.csv --trajectory-rate nan | --trajectory-rate
simulate --strike 0 0 0 0 1 --export-trajectory strike.csv --posture 1 2 3 | 2 numbers
simulate --strike 0 0 0 0 1 --keep-free 0.1 | 0 for an arm without limits
simulate --strike 0 0 0 0 1 --clearance 0.1 | 0 for an arm with neither capsules
simulate --strike 0 0 0 0 1 --floor 0 --export-trajectory strike.csv | within limits; at 0.000 s
simulate --strike 0 0 0 0 1 --trajectory strike.csv | --trajectory: got 'strike.csv'; allowed: only without --strike
optimize --minimise beauty | effort, peak-torque
optimize --minimise robustness --noise 0 | not all 0
optimize --minimise robustness --noise 0.1 -0.1 0 0 0 | 0 or more
optimize --minimise robustness --noise 0.1 0.1 | one number, or 5
optimize --minimise robustness --noise nan | --noise
optimize --minimise robustness --noise 0.2 | so that noisy durations stay positive
optimize --noise 0.02 | only with --minimise robustness
optimize --minimise effort --noise 0.02 | only with --minimise robustness
optimize --pareto effort | --pareto
optimize --pareto effort effort | two different criteria
optimize --pareto effort beauty | peak-torque
optimize --pareto effort miss --minimise speed | only without --pareto
optimize --pareto effort miss --method cmaes | only without --pareto
optimize --pareto effort miss --simulator reference | which has no derivatives
simulate --out taken | new or empty
simulate --video 3 | run folder
train --method a3c | sac, td3, ddpg, ppo
train --method directl | sac, td3, ddpg, ppo
train --observation pixels | tip, relative, goal
train --reward mine | paper, log
train --zone-radius 50 | zone
train --target 9 9 | target
train --hit-radius 100 | --hit-radius: got 100
train --region absent.npz | --region: got
train --region garbage.npz | garbage.npz
train --region good.npz | good.npz
train --region taken | taken
train --region absent.npz --zone-radius 0.3 | --zone-radius
train --region absent.npz --target 1 0 | --target
map-build --region absent.npz | --region: got
map-build --region absent.npz --zone-radius 0.3 | --zone-radius
map-build --region absent.npz --sector 1 2 -1 1 30 | --sector
adapt --limits xm540 | xm430
map-build --sector 1 2 -1 1 | five numbers
map-build --sector 2 1 -1 1 30 | farthest distance
map-build --sector 1 2 -1 1 200 | angle to either side
map-build --sector 1 2 -3 1 30 | lowest height
map-build --sector 1 2 -1 1 30 --target 1 0 0 | --target: got (1.0, 0.0, 0.0); allowed: only without --sector
map-build --sector 1 2 -1 1 30 | coordinates of the zone
map-build --random-strikes 0 | --random-strikes
map-build --room 0 | --room
map-build --rounds -1 | --rounds
map-build --goals 0 | --goals
map-build --gate-strikes -1 | --gate-strikes
map-build --tests 0 | --tests
map-build --limits arm | limits
map-build --cone 0 --arrival-angle 3 | --cone
map-build --cone 20 | --cone
map-build --direction 0 0 | a vector that is not zero
map-build --direction 1 0 --arrival-angle -180 180 | --arrival-angle
map-build --least-speed 0 | --least-speed
map-build --checkpoint x | --checkpoint
map-strike of-simulate | whiptool map
map-strike of-nothing | whiptool map
map-strike nowhere | nowhere
map-strike --arrival-angle nan | --arrival-angle
map-strike --direction 0 0 --target 1 0 | a vector that is not zero
map-strike --cone 181 --arrival-angle 3 | --cone
map-strike --least-speed -1 --target 1 0 | --least-speed
map-strike --t-stay 0.4 | --t-stay
map-strike --refine 3 | command line
map-strike --video 3 | command line
map-strike --posture 1 2 | --posture
map-strike --rest 2 | --rest
map-strike --joint-prefix left_ | --joint-prefix
map-strike --trajectory-rate 9 | --trajectory-rate
map-strike of-simulate --export-trajectory strike.txt | --export-trajectory
train --episodes 2 --random-episodes 99 | --random-episodes
train --direction 0 0 | --direction: got (0.0, 0.0); allowed: a vector that is not zero
train --direction 1 0 0 | --direction: got (1.0, 0.0, 0.0); allowed: 2 coordinates
train --direction 1 nan | direction
train --direction 1 0 --arrival-angle 30 | only without --direction
train --direction 1 0 --target 1.514 0 --zone-radius 0.01 | where arm and whip are stretched to their reach
train --arrival-angle nan | --arrival-angle
train --arrival-angle 90 30 | --arrival-angle: got (90.0, 30.0); allowed: an angle, or FROM TO
train --arrival-angle 0 400 | at most one turn apart
train --arrival-angle 1 2 3 | --arrival-angle
train --arrival-angle -30 30 --cone 0 | --cone
train --arrival-angle 30 --cone 181 | --cone
train --cone 20 | only with --direction
train --least-speed 0 | --least-speed
train --trials 1000000000000 | --trials
train --strikes 0 | --strikes
train --hindsight 2 --observation tip | --hindsight
train --hindsight 2 --method ppo | --hindsight
train --hidden | --hidden
train --hidden 0 | --hidden
train --hidden 1.5 | --hidden
train --learning-rate 0 | --learning-rate
train --learning-rate nan | --learning-rate
train --discount 1.5 | --discount
train --alpha -1 | --alpha
train --alpha 0.1 --method ppo | alpha
train --tau 2 | --tau
train --batch-size 0 | --batch-size
train --updates 0 | --updates
train --noise 0.1 | noise
train --noise nan --method td3 | --noise
train --target-noise 0.1 --method ddpg | --target-noise: got 0.1; allowed: only with --method td3
train --target-noise -1 --method td3 | --target-noise
train --noise-clip inf --method td3 | --noise-clip
train --delay 0 --method td3 | --delay
train --kl-target -1 --method ppo | --kl-target
train --beta nan --method ppo | --beta
train --epochs 0 --method ppo | --epochs
train --minibatch 0 --method ppo | --minibatch
train --spread 0 --method ppo | --spread
train --checkpoint-every 0 | --checkpoint-every
train --tests 0 | --tests
train --tests 1000000000 | --tests
train --resume of-simulate | --resume
compare --methods | --methods
compare --methods sca | method
compare --observation | --observation
compare --observation god | --observation
compare --methods ga --observation tip | --observation
compare --methods ga --episodes 600 | --episodes
compare --methods ga --hindsight 1 | --hindsight
compare --methods sac --observation tip --further-episodes 60 | --further-episodes
compare --zone slow | disc, fast
compare --direction 0 0 | --direction
compare --direction 1 0 0 | 2 coordinates
compare --arrival-angle 90 30 | --arrival-angle
compare --arrival-angle inf | --arrival-angle
compare --arrival-angle 30 --cone nan | --cone
compare --cone 20 | only with --direction
compare --least-speed -1 | --least-speed
compare --zone fast --zone-radius 0.3 | --zone-radius
compare --zone fast --target 1 0 | --target
compare --zone-radius 50 | zone
compare --target 9 9 | target
compare --episodes 10 | --random-episodes
compare --workers 0 | --workers
compare --max-trials 0 | --max-trials
reproduce fig5 --max-trials 0 | --max-trials
reproduce fig5 --cap 40 | --cap
compare --resume of-simulate | --resume
compare --quick 3 | command line
reproduce fig4 | fig5, fig6
reproduce "" | fig5, fig6
reproduce fig5 fig6 | command line
reproduce fig5 --whips 3 | --whips
reproduce aim --targets 10 | only without aim
reproduce nah2023 --seeds 2 | only without nah2023
reproduce spaces --targets 10 | only without spaces
reproduce adapt --whips 0 | --whips
reproduce adapt --whip-targets 0 | --whip-targets
reproduce adapt --rows magic | --rows
reproduce adapt --rows sac | --rows
reproduce adapt --rows | --rows
reproduce adapt --space --rows adapt | --rows
reproduce fig6 --space | --space
reproduce all --rows still | --rows
reproduce fig6 --further-zones slow | --further-zones
reproduce fig6 --further-zones -1 | --further-zones
reproduce fig6 --further-zones 50 | --further-zones
reproduce fig5 --further-zones fast | --further-zones
reproduce fig6 --further-methods magic | method
reproduce fig6 --further-observation god | --further-observation
reproduce fig6 --further-zones --further-methods ga | --further-methods
reproduce fig6 --workers -2 | --workers
reproduce fig6 --resume of-simulate | --resume
human | FOLDER
human absent | folder: got 'absent'
human . | trial_stats.csv
human good.npz | folder
human . --resamples -1 | --resamples
human . --seeds 0 | --seeds
human . --trials 5 | --trials
human . --whips -1 | --whips
human . --draws 1 | --draws
human . --workers 0 | --workers
adapt --target 5 0 | target
adapt --hit-radius 100 | --hit-radius: got 100
adapt --port /dev/nowhere | --camera: got 'points (the default)'
adapt --port /dev/nowhere --camera realsense --family kin | --family
adapt --port /dev/nowhere --camera realsense --no-friction | --friction
adapt --port robot --latency 0.002 | --latency
adapt --port robot --limits xm430 | --limits
adapt --port robot --camera tip | --camera
adapt --model ur5e --target 1 0 0.5 | --port is a robot
adapt --camera webcam | --camera
adapt --camera none | --camera
adapt --camera tip --rate 250 | --rate
adapt --camera tip --no-friction | --friction
adapt --camera tip --latency 0.002 | --latency
adapt --approach-speed 0.1 | --approach-speed
adapt --settle 1 | --settle
adapt --family odd | --family
adapt --material wood | cotton
adapt --diameter 0.01 | --diameter
adapt --length 1 | --length
adapt --material leather --length 0 | length
adapt --material leather --length 50 | --length: got 50
adapt --material leather --diameter 1 | --diameter
adapt --no-still --wiggle | --no-still
adapt --material leather --diameter nan | diameter
adapt --max-strikes 0 | --max-strikes
adapt --whip odd | --whip
adapt --prior absent.toml | absent.toml
adapt --prior broken.toml | broken.toml
adapt --prior zero.toml | zero.toml
adapt --prior taken | taken
adapt --known | --known
adapt --known absent.npz | absent.npz
adapt --known garbage.npz | garbage.npz
adapt --known truncated.npz | truncated.npz
adapt --known taken | taken
adapt --least-speed -1 | --least-speed
adapt --least-speed 1e6 | --least-speed
adapt --cap | --cap
adapt --simulator reference | --simulator
adapt --control-period 0.01 | --control-period
adapt --posture 0 0 | only with --port robot
adapt --rest 1 | only with --port robot
adapt --trajectory-rate 100 | only with --port robot
adapt --joint-prefix left_ | only with --port robot
adapt --true-model lemon2024 | --true-model
adapt --resume of-simulate | --resume
adapt --camera tip --out taken | new or empty
adapt --direction 0 1 | only for a model in space
adapt --arrival-angle 30 | only for a model in space
adapt --cone 5 | --cone
adapt --model ur5e --camera tip --target 1 0 0.5 --direction 1 0 | direction
adapt-next --run absent | --run
adapt-next --run of-simulate | whiptool adapt
adapt-next --run of-adapt recorded.csv | --port robot
adapt-next --run of-robot --posture 1 | --posture
adapt-next --run of-robot good.npz | a strike that was planned
adapt-next --run of-robot good.npz --cameras cameras.toml | --cameras
view good.npz --mcap absent/strike.mcap | --mcap
identify --free | --free
identify --free magic | --free
identify --drive motor | command
identify --drive free --model lemon2024 | .toml
identify --drive free --nodes 5 | --nodes
identify --drive free --profile | --profile
identify --drive free --mend-labels | --mend-labels
identify --drive free --per-recording delay | --per-recording
identify --drive joints --controller constant | --controller
identify space.npz --model ur5e --profile --free length --drive handle | hand or command
identify space.npz --model ur5e --profile --free length --drive joints --per-recording rotation | rotation_x
identify --drive handle --preset printed | --preset
identify --clamp 0.1 | --clamp
identify --drive passive --clamp nan | --clamp
identify --knots | --knots
identify --pieces 0.3 | --pieces
identify --drive free --pieces 0 | --pieces
identify --nodes 0 | --nodes
identify --nodes 5 5 | --nodes
identify --nodes 5 | --nodes
identify --held-out 1 | --held-out
identify --held-out | --held-out
identify --held-out absent.npz | absent.npz
identify --per-recording magic | magic
identify --loss cauchy | huber, none
identify --prior absent.toml | absent.toml
identify --prior empty.toml | empty.toml
identify --tip absent.toml | absent.toml
identify --cameras absent.toml | --cameras
identify --drive free --cameras looks.toml | --cameras
identify --tip zero.toml | zero.toml
identify --tip looks.toml | --tip
identify --out taken | new or empty
identify --model folder.toml | folder.toml
identify absent.csv | absent.csv
identify garbage.csv | garbage.csv
identify empty.csv | empty.csv
identify garbage.npz | garbage.npz
identify truncated.npz | truncated.npz
identify garbage.mat | garbage.mat
identify garbage.c3d | garbage.c3d
identify garbage.db3 | garbage.db3
identify garbage.mkv | garbage.mkv
identify taken | taken
identify file | file
identify good.npz good.npz | once
view of-simulate --page 3 | command line
view absent | absent
view file | file
view taken | taken
view of-garbage | of-garbage
view of-simulate | of-simulate
view garbled | garbled
view | RUN
doctor --deep | --deep
recording-show --cameras absent.toml | absent.toml
recording-show --out taken | --out
recording-show --model magic | magic
recording-show --out shown.jpg | .png
recording-show --out absent/shown.png | --out
recording-show absent.csv | absent.csv
recording-show garbage.csv | garbage.csv
recording-show good.npz good.npz | once
recording-convert good.npz | OUT.csv
recording-convert good.npz good.npz | OUT.csv
recording-convert absent.csv new.csv | absent.csv
recording-convert garbage.db3 new.csv | garbage.db3
recording-convert good.npz good.csv | another name
strike --strike 1 2 | strike
strike --strike 0 0 0 0 0 0 1 | 5 numbers
strike --strike nan 0 0 0 1 | a vector of finite numbers
strike --strike 1e9 0 0 0 1 | --strike
strike --strike 0 0 0 0 1e9 | --strike
strike --strike | --strike
strike --camera webcam | --camera
strike --port /dev/nowhere --camera twin | --camera
strike --port /dev/nowhere --camera absent.db3 | absent.db3
strike --port /dev/nowhere --camera none --true-model lemon2024 | --true-model
strike --port /dev/nowhere --camera none --no-friction | --friction
strike --port /dev/nowhere --camera none --seed 3 | --seed
strike --true-model lemon2025 | lemon2024
strike --true-model "" | model
strike --hit-radius 100 | --hit-radius: got 100
strike --target 50 50 | 70.71 m away
strike --target 5 5 --camera none | target
strike --simulator reference | --simulator
strike --control-period 0.01 | --control-period
strike --timestep 0.0001 | --timestep
strike --integrator RK4 | --integrator
strike --out taken | new or empty
strike --out /proc/nowhere | can be written
learn --method sgd | cmaes
learn --port /dev/nowhere --camera twin | --camera
learn --method gradient | --method
learn --camera none | --camera
learn --max-trials 0 | --max-trials
learn --lower 1 2 | --lower
learn --upper nan nan nan nan nan | --upper, number 1: got nan; allowed: a finite number
learn --target 9 9 | target
learn --resume of-simulate | --resume
learn --resume absent | --resume
servos --port /dev/nowhere | /dev/nowhere
servos --port file | file
servos --port taken | taken
servos --port /dev/null | /dev/null
servos --port "" | port
servos --baud 3 | --baud
servos --set-baud 3 | --set-baud
servos --ids | --ids
servos --ids 1 1 | --ids
servos --ids 300 | --ids
servos --set-id 5 | --set-id
servos --ids 1 --set-id 253 | --set-id
servos --set-return-delay 999 | --set-return-delay
servos --reboot 300 | --reboot
servos --reboot 1 --set-return-delay 0 | --set-return-delay
emulator --baud 3 | baud
emulator --period 0.001 | --period
emulator --lockstep --period 0 | period
emulator --lockstep --period nan | period
emulator --model lemon2025 | lemon2024
emulator --link absent/link | link
ur_emulator --elbow-speed 0 | --elbow-speed
ur_emulator --tool-speed nan | --tool-speed
ur_emulator --command-delay 60 | --command-delay
ur_emulator --command-delay 1.5 | command-delay
ur_emulator --posture 0 0 | posture
ur_emulator --host 10.255.255.1 | --host
ur_emulator --protective-stop -1 | --protective-stop
ur_emulator --emergency-stop nan | --emergency-stop
ur_emulator --cable-pulled -1 | --cable-pulled
optimize --model ur5e --speed-limits elbow=0 | speed > 0
optimize --model ur5e --speed-limits knee=1 | shoulder_pan
optimize --speed-limits hand=1 | plane
emulator --faults flood | --faults
emulator --faults drop:at=soon | --faults
emulator --reboot-time -1 | --reboot-time
studio --port 99999999 | --port
studio --host nowhere.invalid | --host
studio --mcap x.mcap | only with a run folder
studio --least-speed -1 | --least-speed
studio --arrival-angle nan | --arrival-angle
studio --direction 0 0 | a vector that is not zero
studio --cone 5 | only with --direction or --arrival-angle
"""

# What is taken although it looks odd, and why
ACCEPTED = f"""
optimize --torque-limit 1e-9 | an arm without torque hangs: its strikes say so
optimize --max-trials 2147483647 | a budget; Ctrl-C keeps what was found
optimize --method directl --seed 5 | a script may give every method its seed
optimize --target 1.514 0 | the very end of the reach is within the hit radius
simulate --strike {STRIKE} --target 99 99 | a strike is played whatever the target is: the miss tells
train --checkpoint-every 1000 | the last episode is saved in any case
compare --tighter | nothing: no further hit radii
compare --methods ga ga | the same method twice is the method
compare --workers 100000 | as many as there are cores are used, which is said
reproduce fig6 --further-zones | nothing: no further zones
adapt --yes | a script may serve twin and arm
strike --strike {STRIKE} --yes | a script may serve twin and arm
strike --strike {STRIKE} --camera none --hit-radius 0.01 | a target is on record though nobody looks
identify good.npz --starts 1 --seed 7 | of one start nothing is random, yet a script may give it
servos --port /dev/ttyUSB0 --ids 1 --set-id 1 | an id may be set to what it is
"""


LENGTHY = {"HUGE": f"1{'0' * 400}", "LONG": "x" * 5000, "DEEP": "/".join("d" * 300), "NAME": "n" * 300}  # in the tables


def spelled(text: str) -> str:
    """What is given, with what is too lengthy for a table."""
    for word, stands_for in LENGTHY.items():
        text = text.replace(word, stands_for)
    return text


def lines(table: str) -> list[tuple[str, str]]:
    """What is given, and what stands behind the bar."""
    return [
        (given.strip(), said.strip()) for given, _, said in (line.partition("|") for line in table.strip().splitlines())
    ]


def options_of(command: str) -> type[OptionGroup]:
    module, name = OPTIONS[command]
    return getattr(import_module(module), name)


def main_of(command: str) -> Callable[[list[str]], int]:
    if command in ("strike", "learn"):
        from whiptool.commands.rig import main

        return lambda words: main([command, *words])
    if command == "adapt-next":
        from whiptool.commands.adapt import main

        return lambda words: main(["next", *words])
    if command.startswith("recording-"):
        from whiptool.commands.recording import main

        return lambda words: main([command.removeprefix("recording-"), *words])
    if command.startswith("map-"):
        from whiptool.commands.map import main

        return lambda words: main([command.removeprefix("map-"), *words])
    if command.endswith("emulator"):
        return cli.main_of(command)
    home = OPTIONS[command][0]
    return import_module(home).main if home.startswith("whiptool.") else cli.main_of(command)


def flags(command: str) -> set[str]:
    """Its options, as they are given."""
    return {"--" + f.name.replace("_", "-") for f in dataclasses.fields(options_of(command))}


def shared_lines() -> list[tuple[str, str]]:
    found = []
    for command in OPTIONS:
        for given, said in lines(SHARED):
            named = {word for word in shlex.split(given) if word.startswith("--")} - {"--no-json", "--frobnicate"}
            if named <= flags(command) and (command, given) not in ELSEWHERE:
                found.append((f"{command} {NEEDS.get(command, '')} {given}", said))
    return found


def own_lines() -> list[tuple[str, str]]:
    found = []
    for given, said in lines(OWN):
        command, _, rest = given.partition(" ")
        needs = NEEDS.get(command, "")
        positional = command in (
            "identify",
            "view",
            "map-strike",
            "human",
            "recording-show",
            "recording-convert",
        ) and not rest.startswith("--")
        spared = needs.partition(" ")[0] in rest.split() or "--export" in rest or positional
        found.append((f"{command} {'' if spared else needs} {rest}".strip(), said))
    return found


BAD = [*shared_lines(), *own_lines()]


def recording() -> StrikeRecording:
    t = np.arange(40) / 60
    points = np.stack([np.sin(3 * t), -np.cos(3 * t)], axis=1)
    return StrikeRecording(
        t, points[:, None], ("tip",), np.array(0.005), strike=Strike((-0.6, 0.2), (0.7, 2.1), 0.5), t_stay=0.1
    )


def in_space() -> StrikeRecording:
    """The same in the plane of x and z."""
    flat = recording()
    points = np.insert(flat.points, 1, 0.0, axis=-1)
    strike = Strike.from_vector([*6 * [0.0], *6 * [0.5], 0.5])
    return dataclasses.replace(flat, points=points, sigma=np.array(0.005), strike=strike)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files and folders of every wrong kind."""
    folder = tmp_path_factory.mktemp("bad")
    garbage = bytes(range(256)) * 20
    link = "{mass = 1, length = 1}"
    table = "[whip]\nN = {N}\nl = 0.1\nm = {m}\nk = 0.1\nb = 0.1\n[arm]\nlinks = [{{mass = 1, length = 1}}]\n"
    texts = {
        "empty": "",
        "broken": "[whip\n",
        "zero": table.format(N=0, m=0.1),
        "negative": table.format(N=2, m=-0.1),
        "infinite": table.format(N=2, m="inf"),
        "heavy": table.format(N=2, m=1e308),
        "text": table.format(N=2, m='"light"'),
        "many": table.format(N=2, m="[0.1, 0.1, 0.1]"),
        "list": "whip = [1, 2]\n",
        "three": table.format(N=2, m=0.1).replace(f"[{link}]", f"[{link}, {link}, {link}]"),
        "hand": '[controller]\nlaw = "oiac"\n[controller.hand]\n',
        "magic": '[controller]\nlaw = "oiac"\n[controller.hand]\nmagic = 3\n',
        "looks": "radius = 0.01\nhue = [0, 20]\nsaturation = 0.5\n",
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "utf16.toml").write_text("name = 'x'", encoding="utf-16")
    for suffix in ("csv", "npz", "mat", "c3d", "db3", "mkv"):
        (folder / f"garbage.{suffix}").write_bytes(garbage)
    (folder / "gibberish.toml").write_bytes(garbage)  # not garbage.toml: beside a recording that is its sidecar
    (folder / "empty.csv").touch()
    (folder / "file").write_text("mine")
    (folder / "folder.toml").mkdir()
    recording().save(folder / "good.npz")
    in_space().save(folder / "space.npz")
    (folder / "truncated.npz").write_bytes((folder / "good.npz").read_bytes()[:400])
    (folder / "taken").mkdir()
    (folder / "taken" / "file").write_text("mine")
    configs = {
        "of-simulate": 'command = "simulate"\n[options]\n',
        "of-adapt": 'command = "adapt"\n[options]\nport = "twin"\n',
        "of-robot": 'command = "adapt"\n[options]\nport = "robot"\n',
        "of-garbage": "\x01[",
        "of-nothing": 'command = "optimize"\n',
        "of-others": 'command = "optimize"\n[options]\nmagic = 3\n',
        "garbled": 'command = "optimize"\n[options]\n',
        "of-no-model": 'command = "optimize"\nmodel = 3\n[options]\n',
        "of-option-list": 'command = "optimize"\noptions = [1]\n',
        "of-path-list": 'command = "optimize"\n[options]\nout = [1]\n',
    }
    for name, text in configs.items():
        (folder / name).mkdir()
        (folder / name / "config.toml").write_text(text)
    (folder / "garbled" / "trajectory.npz").write_bytes(garbage)
    for name in ("of-no-model", "of-option-list"):
        (folder / name / "trajectory.npz").write_bytes(garbage)
    write_model(preset("nah2020-n10"), folder / "good.toml")
    make_hostile(folder, table)
    return folder


def make_hostile(folder: Path, table: str) -> None:
    """Files that are huge, deep, endless, or of another kind, in a folder; `table` is a model's."""
    huge, good = LENGTHY["HUGE"], table.format(N=2, m=0.1)
    robot = '<robot name="r">{}</robot>'
    texts = {
        "huge.toml": table.format(N=2, m=huge),
        "huge-n.toml": table.format(N=huge, m=0.1),
        "digits.toml": table.format(N=2, m="1" * 5000),
        "tiny-mass.toml": table.format(N=2, m=1e-310),
        "tiny-length.toml": good.replace("l = 0.1", "l = 1e-310"),
        "tiny-link.toml": good.replace("mass = 1,", "mass = 1e-310,"),
        "far.toml": good.replace("length = 1}", "length = 1e6}"),
        "name-in-lines.toml": f'name = "a\\nb"\n{good}',
        "arrays.toml": "m = " + "[" * 100_000,
        "dots.toml": "a" + ".a" * 200_000 + " = 1",
        "of-pipe.toml": good.replace("links = [{mass = 1, length = 1}]", 'file = "pipe.urdf"'),
        "includes.xml": '<mujoco><include file="pipe.xml"/></mujoco>',
        "replicate.xml": '<mujoco><worldbody><replicate count="100000"><body><geom size="1"/></body></replicate>'
        "</worldbody></mujoco>",
        "deep.urdf": robot.format("<link>" * 10_000 + "</link>" * 10_000),
        "deep.xml": "<mujoco>" + "<body>" * 10_000 + "</body>" * 10_000 + "</mujoco>",
        "entities.urdf": '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>' + robot.format("&b;"),
        "huge-gain.toml": f'[controller]\nlaw = "constant"\nK = [[{huge}, 0], [0, 1]]\n',
        "law-list.toml": "[controller]\nlaw = [1]\n",
        "huge-prior.toml": f'"whip.m" = {{value = {huge}, error = 0.1}}\n',
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    for suffix in ("toml", "npz", "csv", "urdf", "xml"):
        os.mkfifo(folder / f"pipe.{suffix}")
    (folder / "device.toml").symlink_to("/dev/zero")
    np.savez(folder / "pickled.npz", corners=np.array([print], object), t=np.array([print], object))
    with zipfile.ZipFile(folder / "petabyte.npz", "w") as archive:
        for name in ("corners.npy", "t.npy"):
            buffer = io.BytesIO()
            np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**14, 2)})
            archive.writestr(name, buffer.getvalue())
    runs = {"pickled-run": "pickled.npz", "foreign-run": "good.npz"}
    for name in ("pickled-run", "foreign-run", "empty-run"):
        (folder / name).mkdir()
        write_whole(
            folder / name / "config.toml",
            tomli_w.dumps({"command": "optimize", "options": {}, "model": model_to_table(preset("lemon2024"))}),
        )
        content = (folder / runs[name]).read_bytes() if name in runs else b""
        (folder / name / "trajectory.npz").write_bytes(content)


def tree(folder: Path) -> list[tuple[str, int]]:
    return sorted((str(path), path.stat().st_size) for path in folder.rglob("*"))


@pytest.mark.parametrize(("given", "said"), BAD, ids=[" ".join(given.split()) for given, _ in BAD])
def test_bad_input_is_one_line_that_names_it(given: str, said: str, files: Path, capsys, monkeypatch) -> None:
    command, *words = shlex.split(spelled(given))
    monkeypatch.chdir(files)
    before, handler = tree(files), signal.getsignal(signal.SIGTERM)
    try:
        status = main_of(command)(words)
    finally:
        signal.signal(signal.SIGTERM, handler)
    answer = capsys.readouterr()
    assert answer.err.count("\n") == 1, answer.err
    assert spelled(said) in answer.err
    assert len(answer.err) < 3000
    assert status == 2, answer.err
    assert answer.out == ""
    assert tree(files) == before


@pytest.mark.parametrize("given", [given for given, _ in lines(ACCEPTED)])
def test_what_is_accepted_is_parsed(given: str, files: Path, monkeypatch) -> None:
    """Options alone: nothing is computed."""
    command, *words = shlex.split(given)
    monkeypatch.chdir(files)
    cli.parse(options_of(command), prog=command, description="", args=words)


def test_every_accepted_line_has_its_reason() -> None:
    assert all(reason for _, reason in lines(ACCEPTED))


@pytest.mark.parametrize("command", OPTIONS)
def test_every_option_is_in_a_table(command: str) -> None:
    """What can be wrong with none: flags without a value, and where a refused line would need a rig."""
    alone = {"--yes", "--feedforward", "--wiggle", "--still", "--lockstep", "--friction", "--cap", "--quick"}
    alone |= {"--for-strikes", "--quiet", "--live", "--browser"}
    without = {*alone, "--resume", "--out", "--run", "--recording", "--recordings", "--what", "--folder"}
    without |= {"--file", "--files"}
    given = " ".join(given for given, _ in [*BAD, *lines(ACCEPTED)] if given.startswith(command + " "))
    assert flags(command) - without <= set(shlex.split(given))


@pytest.mark.parametrize(
    "words",
    [
        ["optimize", "--target", "nan", "0"],
        ["rig", "strike"],
        ["rig", "whip"],
        ["simulate", "--strike", "0", "0", "0", "0", "\udcff"],
        ["frobnicate"],
    ],
)
def test_the_installed_command_says_the_same(words: list[str], tmp_path: Path) -> None:
    whole = [sys.executable, "-c", "import sys; from whiptool.commands.cli import main; sys.exit(main())", *words]
    done = subprocess.run(whole, cwd=tmp_path, capture_output=True, timeout=HANG, check=False)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1, done.stderr
    assert done.stdout == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("words", [["simulate", "--export", "full"], ["doctor", "--json"]])
def test_a_full_disk_is_one_line(words: list[str], tmp_path: Path) -> None:
    """Through a link: whatever goes wrong, the machine keeps its device."""
    (tmp_path / "full").symlink_to("/dev/full")
    whole = [sys.executable, "-c", "import sys; from whiptool.commands.cli import main; sys.exit(main())", *words]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            whole, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, timeout=HANG, check=False, env={**os.environ}
        )
    assert done.returncode in (1, 2)
    assert (tmp_path / "full").is_symlink()
    assert Path("/dev/full").is_char_device()
    assert done.stderr.count(b"\n") == 1, done.stderr


def test_what_a_run_was_begun_with_is_kept(tmp_path: Path) -> None:
    """`--no-video`, `--checkpoint-every`, `--workers` are not said again on `--resume`; they may be said otherwise."""
    from whiptool.commands.optimize import OptimizeOptions
    from whiptool.runs import RunFolder

    begun = OptimizeOptions(video=False, max_time=3.0)
    folder = RunFolder.create(tmp_path / "run", {"command": "optimize", "options": run_folders.as_plain(begun)})
    del folder

    def resumed(*words: str) -> OptimizeOptions:
        return cli.parse_resumable(
            OptimizeOptions,
            command="optimize",
            description="",
            args=["--resume", str(tmp_path / "run"), *words],
        )

    assert not resumed().video
    assert resumed("--video").video
    assert resumed().max_time == 3.0
    for words in (["--max-time", "4"], ["--max-time", "None"], ["--seed", "1"]):
        with pytest.raises(InputError, match=words[0]):
            resumed(*words)


def test_quick_leaves_what_is_given() -> None:
    """`--targets 300` is what it says, though 300 is the default that `--quick` replaces."""
    from whiptool.commands.compare import QUICK, CompareOptions

    def given(*words: str) -> CompareOptions:
        return cli.parse_resumable(
            CompareOptions,
            command="compare",
            description="",
            args=words,
            quick=QUICK,
        )

    assert given("--quick", "--targets", "300").targets == 300
    assert given("--quick").targets == QUICK["targets"]
    assert given().targets == 300

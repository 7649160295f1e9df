"""Opens a recording with results in Rerun: the room in space, figures as plots, the log.

    pip install rerun-sdk
    python docs/view_in_rerun.py results.mcap
    python docs/view_in_rerun.py results.mcap --save results.rrd     to save a file instead

Rerun also opens the file without this script (`rerun results.mcap`). The script lays out the views and plots the figures;
Rerun alone does not plot schemas that it does not know.
"""

import argparse

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

FIGURES = "radar_chaperone.results.Figures:message"
PLOTS = {
    "distance to the nearest (m)": {
        "nearest_obstacle_m": (255, 140, 26),
        "nearest_wall_m": (77, 153, 255),
    },
    "obstacles and walls known": {"obstacles": (255, 140, 26), "walls": (77, 153, 255)},
    "sweeps a second": {"sweeps_per_s": (90, 220, 150)},
    "time offset, applied and estimated (ms)": {
        "time_offset_ms": (230, 230, 230),
        "time_offset_estimate_ms": (255, 230, 90),
    },
}


def plot(title, series):
    """One plot of some fields of the figures."""

    def line(field, color):
        source = VisualizerComponentMapping(
            "Scalars:scalars",
            ComponentSourceKind.SourceComponent,
            source_component=FIGURES,
            selector="." + field,
        )
        return rr.SeriesLines(names=field, colors=color, widths=1.5).visualizer(mappings=[source])

    lines = [line(field, color) for field, color in series.items()]
    # The last minute before the cursor.
    shown = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-60), end=rr.TimeRangeBoundary.cursor_relative(seconds=0)
    )
    return rrb.TimeSeriesView(
        name=title,
        origin="/figures",
        overrides={"/figures": lines},
        axis_x=rrb.TimeAxis(view_range=shown),
        plot_legend=rrb.Corner2D.LeftTop,
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file")
    arguments.add_argument("--save", metavar="FILE.rrd", help="write it instead of opening it")
    arguments = arguments.parse_args()
    room = rrb.Spatial3DView(
        name="room",
        origin="/",
        contents=["+ /room", "+ /tracking/**", "+ /beam/outline", "+ /scene/points", "+ /scene/outlines", "+ /evidence"],
        spatial_information=rrb.SpatialInformation("room", show_axes=True),
        eye_controls=rrb.EyeControls3D(position=(-3.2, -3.8, 4.3), look_target=(0.2, 0.1, 0.7), eye_up=(0.0, 0.0, 1.0)),
    )
    plots = rrb.Vertical(*[plot(title, series) for title, series in PLOTS.items()])
    log = rrb.TextLogView(name="log", origin="/log")
    layout = rrb.Horizontal(rrb.Vertical(room, log, row_shares=[3, 1]), plots, column_shares=[3, 2])
    blueprint = rrb.Blueprint(
        layout,
        # At the end of the recording, where most is known.
        rrb.TimePanel(state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
    rr.init("radar-chaperone", spawn=not arguments.save)
    if arguments.save:
        rr.save(arguments.save, default_blueprint=blueprint)
    else:
        rr.send_blueprint(blueprint)
    rr.log_file_from_path(arguments.file)


main()

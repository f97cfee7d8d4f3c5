"""Layout of the viewer: the room, the events, and plots beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import rerun as rr
import rerun.blueprint as rrb

from bridge.view.rerun import paths

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan

_SHORTEST_S = 1.0
"""Minimum length of the time axis of a recorded run, s."""
_DEFAULT_BOUNDS = (-2.0, -2.0, 2.0, 2.0)
"""Bounds of the view for an unknown room, m."""
_VIEW_HEIGHT = 1.05
"""Camera height relative to the size of the room, with a margin around it."""
_NEWEST_S = 60.0
"""Time for which a path, a lane and the true path have their full colour, s. In this time the robot
drives 12 m at 0.2 m/s."""
_LIVE_S = 60.0
"""Time span of the plots during a live run, s."""


def blueprint(plan: FloorPlan | None, duration_s: float | None) -> rrb.Blueprint:
    """Return the layout for one run, with the whole room and the whole duration.

    If ``duration_s`` is None, the run is live and the plots show the last minute.
    """
    if duration_s is None:
        start = rr.TimeRangeBoundary.cursor_relative(seconds=-_LIVE_S)
        end = rr.TimeRangeBoundary.cursor_relative(seconds=0.0)
    else:
        start = rr.TimeRangeBoundary.absolute(seconds=0.0)
        end = rr.TimeRangeBoundary.absolute(seconds=max(duration_s, _SHORTEST_S))
    time = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))

    def plot(origin: str, name: str) -> rrb.TimeSeriesView:
        legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=time, plot_legend=legend)

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _room(plan),
                rrb.Horizontal(
                    rrb.TextDocumentView(origin=paths.PLANNER_TEXT, name="Planner"),
                    rrb.StateTimelineView(
                        origin=paths.STATES, name="Planner, mode and stop", time_view=time
                    ),
                    column_shares=[2, 3],
                ),
                rrb.TextLogView(
                    origin=paths.EVENTS,
                    name="Events and log",
                    columns=rrb.TextLogColumns(
                        timeline_columns=[paths.TIMELINE], text_log_columns=["LogLevel", "Body"]
                    ),
                ),
                row_shares=[7, 3, 3],
            ),
            rrb.Vertical(
                plot(paths.VELOCITY, "Speed (m/s)"),
                plot(paths.YAW_RATE, "Yaw rate and gyro (rad/s)"),
                plot(paths.WHEELS, "Wheels (m/s)"),
                plot(paths.RANGE, "Ranges (m)"),
                rrb.Horizontal(
                    plot(paths.ACCELERATION, "IMU acceleration (m/s²)"),
                    plot(paths.POSE_ERROR, "Pose error (mm)"),
                ),
                rrb.Horizontal(
                    plot(paths.BATTERY, "Battery (V)"),
                    plot(paths.CURRENT, "Motors (A)"),
                ),
                rrb.Horizontal(
                    plot(paths.CLOCK, "Clock (ms)"),
                    plot(paths.LINK, "Link"),
                ),
            ),
            column_shares=[1, 1],
        ),
        rrb.TimePanel(
            timeline=paths.TIMELINE,
            play_state=rrb.components.PlayState.Following,
            state="collapsed",
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _room(plan: FloorPlan | None) -> rrb.Spatial3DView:
    x_min, y_min, x_max, y_max = plan.bounds() if plan is not None else _DEFAULT_BOUNDS
    centre = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    size = max(x_max - x_min, y_max - y_min)
    so_far = rrb.VisibleTimeRanges(
        timeline=paths.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    newest = rrb.VisibleTimeRanges(
        timeline=paths.TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_NEWEST_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=paths.WORLD,
        name="Room from above",
        background=rrb.Background(color=paths.BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            # Slightly off the vertical, because a vertical view has no defined direction of "up".
            position=(centre[0], centre[1] - 1e-3 * size, _VIEW_HEIGHT * size),
            look_target=(centre[0], centre[1], 0.0),
            eye_up=(0.0, 1.0, 0.0),
        ),
        # The whole path of a long run in full colour is unreadable, so only the last minute has it.
        overrides={
            **dict.fromkeys((paths.WHOLE_PATH, paths.OCCLUDED), so_far),
            **dict.fromkeys((paths.PATH, paths.TRUTH_PATH, paths.LANES), newest),
        },
    )

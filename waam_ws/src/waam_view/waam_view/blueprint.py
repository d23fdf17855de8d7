"""Layout of the dashboard, and the names of what is logged."""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb

TIMELINE, LAYERS = 'ros_time', 'layer'
SURFACE, PLAN, PATH, TORCH = 'part/surface', 'part/plan', 'part/path', 'part/torch'
ERROR, PSI, CONFIDENCE = 'maps/error', 'maps/psi', 'maps/confidence'
ERROR_PLACES, PLACES = 'maps/error/places', 'part/places'
CURRENT, VOLTAGE, FEED, TRAVEL = 'arc/current', 'arc/voltage', 'feed/wire', 'feed/travel'
TEMPERATURE, LIMIT, HEAT_FACTOR = 'heat/temperature', 'heat/limit', 'heat/factor'
MACHINE, JOB, LAYER, RMS = 'state/machine', 'state/job', 'state/layer', 'quality/rms'
STATUS, LOG, ALARMS = 'status', 'log', 'log/alarms'

_BLUE, _RED, _GREY, _GREEN = (28, 111, 184), (194, 59, 49), (138, 148, 160), (35, 131, 63)
SERIES = {  # entity: (names, colours)
    CURRENT: (['current, A'], [_BLUE]),
    VOLTAGE: (['voltage, V'], [_RED]),
    FEED: (['commanded, m/min', 'actual, m/min'], [_GREY, _BLUE]),
    TRAVEL: (['commanded, mm/s', 'actual, mm/s'], [_GREY, _BLUE]),
    TEMPERATURE: (['temperature, °C'], [_RED]),
    LIMIT: (['interpass limit, °C'], [_GREY]),
    HEAT_FACTOR: (['heat factor, %'], [_GREEN]),
    RMS: (['RMS height error, mm', 'largest, mm'], [_BLUE, _GREY]),
}


def blueprint(
    error_range_m: float,
    window_s: float = 0.0,
    whole_ns: tuple[int, int] | None = None,
) -> rrb.Blueprint:
    """The layout. error_range_m: ends of the error colours; window_s > 0: plots show that many seconds before the
    cursor (live); whole_ns: they show this range (a job that has ended).
    """
    span = None if whole_ns is None else rrb.TimeRange(*(_at(t) for t in whole_ns))
    axis = None if span is None else rrb.TimeAxis(view_range=span)
    columns = (_part(axis), _maps(error_range_m), _plots(axis, window_s))
    return rrb.Blueprint(
        rrb.Horizontal(*columns, column_shares=[5, 3, 4]),
        rrb.TimePanel(state='collapsed', timeline=TIMELINE, play_state='following'),
        rrb.SelectionPanel(state='collapsed'),
        rrb.BlueprintPanel(state='collapsed'),
    )


def _part(axis: rrb.TimeAxis | None) -> rrb.Vertical:
    """The part in 3-D, the messages and the states."""
    space = rrb.Spatial3DView(
        origin='part',
        name='Part (surface: colours of the error, beside the beads: of the height)',
        background=rrb.Background(color=(24, 27, 31)),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.01),
    )
    words = rrb.Tabs(
        rrb.TextLogView(origin=LOG, name='Log and alarms'),
        rrb.TextLogView(origin=ALARMS, name='Alarms'),
        active_tab=0,
    )
    status = rrb.TextDocumentView(origin=STATUS, name='Status')
    states = rrb.StateTimelineView(origin='state', name='States and layers', time_view=axis)
    said = rrb.Horizontal(status, words, column_shares=[1, 2])
    return rrb.Vertical(space, said, states, row_shares=[5, 2.7, 1.2])


def _maps(error_range_m: float) -> rrb.Vertical:
    """The height error, and beside it the correction."""
    reach = f'{error_range_m * 1e3:g}'
    return rrb.Vertical(
        rrb.Spatial2DView(
            origin=ERROR, name=f'Height error (blue -{reach} mm ... red +{reach} mm)'
        ),
        rrb.Spatial2DView(origin=PSI, name='ψ (blue -1: slower, more metal ... red +1)'),
        rrb.Spatial2DView(origin=CONFIDENCE, name='Confidence of ψ (dark 0 ... yellow 1)'),
    )


def _plots(axis: rrb.TimeAxis | None, window_s: float) -> rrb.Vertical:
    """Curves over time."""

    def plot(name: str, origin: str, *more: str) -> rrb.TimeSeriesView:
        contents = ['$origin/**', *(f'+ /{entity}' for entity in more)]
        ranges = _last(window_s) if window_s > 0 and origin != RMS else None
        return rrb.TimeSeriesView(
            origin=origin, name=name, contents=contents, axis_x=axis, time_ranges=ranges
        )

    heat = rrb.Tabs(
        plot('Temperature and interpass limit', TEMPERATURE, LIMIT),
        plot('Heat factor', HEAT_FACTOR),
        active_tab=0,
    )
    curves = (
        plot('Arc current', CURRENT),
        plot('Arc voltage', VOLTAGE),
        plot('Wire feed', FEED),
        plot('Travel speed', TRAVEL),
        heat,
        plot('Height error', RMS),
    )
    return rrb.Vertical(*curves)


def _at(t_ns: int) -> rrb.TimeRangeBoundary:
    return rrb.TimeRangeBoundary.absolute(nanos=t_ns)


def _last(seconds: float) -> rrb.VisibleTimeRange:
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
    return rrb.VisibleTimeRange(TIMELINE, start=start, end=rrb.TimeRangeBoundary.cursor_relative())


def log_styles(recording: rr.RecordingStream) -> None:
    """Names and colours of the curves; once per recording."""
    for entity, (names, colours) in SERIES.items():
        recording.log(entity, rr.SeriesLines(names=names, colors=colours), static=True)
    recording.log('part', rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

"""Benchmarks: `python -m tools.bench.NAME`. Each prints its seed, what is asked, and what was measured.

- Figures of the README, on recordings: solve, replay_live, station_folder, gnss_recordings, detection, detection_int8,
  detection_rendered.
- Figures on made-up scenes, over many seeds: station_tracking, station_guard, station_day, survey_network,
  clocks (set at random, found again), solve_hazards (what people bring: is the answer ever confidently wrong?),
  survey_sigma.
- Acceptance, with real processes, faults and enemies: field, impostors, intruder, mavlink_forgery, mavlink_peers,
  scale, gnss_corruption.
- Profiling, what it costs: station_load, edge_speed, edge_memory, edge_stamps, edge_formats, memory, page,
  gnss_throughput.

What they stand on (scenes, boxes, receivers, listeners, base processes) is in tools/doubles, which tests use as well.
"""

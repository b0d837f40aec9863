"""Costmaps in layers, after costmap_2d: each layer writes what it knows of obstacles into one grid of costs."""

LAYERS = {
    "costmap_2d::StaticLayer": "mbf_relay.costmap.static_layer.StaticLayer",
    "costmap_2d::ObstacleLayer": "mbf_relay.costmap.obstacle_layer.ObstacleLayer",
    "costmap_2d::VoxelLayer": "mbf_relay.costmap.obstacle_layer.VoxelLayer",
    "rtabmap_ros::StaticLayer": "mbf_relay.costmap.static_layer.StaticLayer",
    "rtabmap_costmap_plugins::StaticLayer": "mbf_relay.costmap.static_layer.StaticLayer",
    "nav2_costmap_2d::KeepoutFilter": "mbf_relay.costmap.costmap_filter.KeepoutFilter",
    "nav2_costmap_2d::SpeedFilter": "mbf_relay.costmap.costmap_filter.SpeedFilter",
    "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer":
        "mbf_relay.costmap.spatio_temporal_layer.SpatioTemporalLayer",
    "range_sensor_layer::RangeSensorLayer": "mbf_relay.costmap.range_layer.RangeSensorLayer",
    "costmap_prohibition_layer_namespace::CostmapProhibitionLayer":
        "mbf_relay.costmap.prohibition_layer.ProhibitionLayer",
    "costmap_prohibition_layer_v2::CostmapProhibitionLayer": "mbf_relay.costmap.prohibition_layer.ProhibitionLayer",
    "mbf_relay::TrackLayer": "mbf_relay.costmap.track_layer.TrackLayer",
    "costmap_2d::InflationLayer": "mbf_relay.costmap.inflation_layer.InflationLayer",
}
"""The class that implements each layer type which parameter files may name."""

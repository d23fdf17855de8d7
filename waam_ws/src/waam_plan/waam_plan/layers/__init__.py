"""From covered layers to segments with metal, speed and idle moves: builds, restorations, scans."""

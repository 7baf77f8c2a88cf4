"""Reading of URDF and SDFormat as found: XML with lines, poses, the tree of links and joints."""

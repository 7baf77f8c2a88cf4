"""A robot's folder out of a URDF or SDFormat file as it is found.

`importer.import_robot` is the whole of it: `reading` has the file read by Drake's parser, of which
`chain` keeps vehicle and arm; `bodies` lumps fixed links, in the axes of this project; `plugins`
has water and thrusters, and `estimates` fills in missing numbers.
"""

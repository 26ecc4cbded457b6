function folders = path()
folders = {};

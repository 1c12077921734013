MORE=[]
